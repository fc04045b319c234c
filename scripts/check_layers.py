#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fails when a module includes a header of one that does not lie below it, or a library it must not know.

Localization knows Eigen, Ceres and OpenCV; mapping knows LibTorch; only bridge and the program know both.
"""
import pathlib
import re
import subprocess
import sys

# What each module may include, besides itself and whatever those may include in turn.
BELOW = {
    "core": [],
    "config": ["core"],
    "geometry": ["core"],
    "loop": ["geometry"],
    "sensors": ["config", "geometry"],
    "imu": ["sensors"],
    "dipo": ["imu"],
    "vio": ["imu"],
    "fusion": ["dipo", "vio"],
    "io": ["sensors"],
    "eval": ["io"],
    "sim": ["io"],  # shares nothing with the estimators it judges
    "doctor": ["io", "imu"],
    "pipeline": ["fusion", "eval"],
    "splat": ["core"],
    "mapping": ["splat"],
    "bridge": ["pipeline", "loop", "mapping"],
    "apps": ["bridge", "doctor", "sim"],
}
TORCH = {"splat", "mapping", "bridge", "apps"}
LOCALIZATION_LIBRARIES = set(BELOW) - {"core", "config", "splat", "mapping"}

INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]', re.MULTILINE)
IS_TORCH = re.compile(r"^(torch|ATen|c10)/")
IS_LOCALIZATION_LIBRARY = re.compile(r"^(Eigen|opencv2|ceres|unsupported/Eigen)/")
TORCH_WITH_CUDA = ("kernels/cuda_backend.cpp", "kernels/cuda_raster.cpp",
                   "kernels/mapping/cuda_depth.cpp", "kernels/mapping/cuda_step.cpp")


def reachable(module):
    modules, todo = set(), [module]
    while todo:
        name = todo.pop()
        if name not in modules:
            modules.add(name)
            todo += BELOW[name]
    return modules


def module_of(name):
    """The module that a file belongs to; None for files that may include anything (test support)."""
    parts = pathlib.PurePath(name).parts
    if parts[0] in ("kernels", "cpu_fallback"):
        return "mapping" if "mapping" in parts[1:-1] else "splat"
    if parts[:2] == ("include", "apvi") and len(parts) > 3:
        return parts[2]
    if parts[0] in ("src", "tests") and len(parts) > 2 and parts[1] in BELOW:
        return parts[1]
    return None


def complaint(name, module, header):
    """Why the file must not include the header, or None."""
    is_test = name.startswith("tests/")
    if name.startswith("kernels/") and name not in TORCH_WITH_CUDA and IS_TORCH.match(header):
        return "kernels are free of LibTorch, so that nvcc alone compiles them"
    if IS_TORCH.match(header) and module not in TORCH:
        return f"{module} does not know LibTorch"
    if IS_LOCALIZATION_LIBRARY.match(header) and module not in LOCALIZATION_LIBRARIES:
        return f"{module} does not know Eigen, OpenCV or Ceres"
    match = re.match(r"apvi/(\w+)/", header)
    if match and not is_test and match.group(1) not in reachable(module):
        return f"{match.group(1)} does not lie below {module}"
    return None


def main():
    root = pathlib.Path(__file__).resolve().parent.parent
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard",
               "*.hpp", "*.cpp", "*.cu", "*.cuh"]
    listed = subprocess.run(command, cwd=root, check=True, capture_output=True, text=True)
    complaints = []
    for name in listed.stdout.split():
        module = module_of(name)
        if module is None or not (root / name).is_file():
            continue
        if module not in BELOW:
            complaints.append(f"{name}: {module} is missing in the list of modules of {__file__}")
            continue
        for header in INCLUDE.findall((root / name).read_text(encoding="utf-8")):
            reason = complaint(name, module, header)
            if reason:
                complaints.append(f"{name}: includes {header}, but {reason}")
    print("\n".join(complaints) or "layers: every include points downwards")
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
