#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fails when an include breaks the layers of the modules.

- A module includes only headers of the modules below it (BELOW).
- Localization may use Eigen, Ceres and OpenCV; mapping may use LibTorch; slam and runs may use both.
- CUDA sources never include LibTorch, directly or indirectly: nvcc compiles them without it.
- Public headers (include/apvi) include only public headers. Each is used outside its module, or is
  included by apvi/apvi.hpp.
- Every type that a public header declares is defined in one.
- Examples include only public headers.
"""
import functools
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent

# Direct dependencies of each module; headers of indirect dependencies may be included as well.
BELOW = {
    "core": [],
    "config": ["core"],
    "geometry": ["core"],
    "sensors": ["config", "geometry"],
    "imu": ["sensors"],
    "dipo": ["imu"],
    "vio": ["imu"],
    "fusion": ["dipo", "vio"],
    "loop_closure": ["sensors"],
    "io": ["sensors"],
    "eval": ["io"],
    "live": ["io"],
    "doctor": ["io", "vio"],
    "importer": ["doctor", "io", "vio"],
    "sim": ["io"],  # independent of the estimators that are tested with its data
    "localization": ["fusion", "loop_closure"],
    "gaussians": ["core"],
    "medium": ["gaussians"],
    "depth": ["medium"],
    "map_io": ["medium"],
    "mapping": ["depth"],
    "slam": ["localization", "loop_closure", "mapping"],
    "viewer": ["geometry"],
    "survey": ["mapping", "geometry"],
    "change": ["mapping", "geometry"],
    "runs": ["slam", "map_io", "io", "live", "eval", "viewer", "survey", "change"],
    "cli": ["runs", "doctor", "importer", "sim"],
    "python": ["runs", "doctor"],
}
# The mapping half, which is built without the module `config` as well (preset `island`), but may
# include this header of it, of which it needs the templates only.
MAPPING_HALF = {"gaussians", "medium", "depth", "map_io", "mapping"}
FOR_MAPPING_HALF = "apvi/config/fields.hpp"
TORCH = MAPPING_HALF | {"slam", "survey", "change", "runs", "cli", "python"}
LOCALIZATION_LIBRARIES = set(BELOW) - MAPPING_HALF - {"core", "config"}
# Modules of the folders in kernels/ and cpu_fallback/.
BACKENDS = {"common": "gaussians", "raster": "gaussians", "loss": "gaussians", "optimizer": "gaussians",
            "medium": "medium", "depth": "depth", "training": "mapping"}
UMBRELLA = "include/apvi/apvi.hpp"  # what it includes is the API, whether used in this repository or not
GENERATED = {"apvi/version.hpp"}

INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]', re.MULTILINE)
IS_TORCH = re.compile(r"^(torch|ATen|c10)/")
IS_LOCALIZATION_LIBRARY = re.compile(r"^(Eigen|opencv2|ceres|unsupported/Eigen)/")
DECLARATION = re.compile(r"^(?:class|struct) (\w+);", re.MULTILINE)  # not in a class
DEFINITION = re.compile(r"^(?:class|struct|enum class) (\w+)(?: final)?(?: : [^{;]+)? *\{", re.MULTILINE)
KERNEL_HOST = re.compile(r"^kernels/\w+/cuda_\w+\.cpp$")  # hands the memory of tensors to kernels


def reachable(module):
    modules, todo = set(), [module]
    while todo:
        name = todo.pop()
        if name not in modules:
            modules.add(name)
            todo += BELOW[name]
    return modules


def folder_of(name):
    """The folder that decides on the module of a file or of a header as included, or None."""
    parts = pathlib.PurePath(name).parts
    if parts[0] in ("kernels", "cpu_fallback", "src", "tests", "apvi"):
        return parts[1] if len(parts) > 2 else None
    if parts[:2] == ("include", "apvi"):
        return parts[2] if len(parts) > 3 else None
    return parts[0] if len(parts) > 1 and parts[0] in BELOW else None


def module_of(name):
    """Module of a file or of a header as included; None if it has none (tests, third parties)."""
    folder = folder_of(name)
    if name.startswith(("kernels/", "cpu_fallback/")):
        return BACKENDS.get(folder)
    return folder if folder in BELOW else None


@functools.lru_cache(maxsize=None)
def includes_of(name):
    """(header as written, whether in quotes) of all includes of a file."""
    text = (ROOT / name).read_text(encoding="utf-8")
    return [(header, quote == '"') for quote, header in INCLUDE.findall(text)]


@functools.lru_cache(maxsize=None)
def resolve(header, name):
    """Path in this repository of a header that `name` includes, or None."""
    for folder in ("include", "src", ".", "tests", pathlib.PurePath(name).parent):
        if (ROOT / folder / header).is_file():
            return str(pathlib.PurePath(folder) / header)
    return None


def torch_chain(name, seen=None):
    """Includes through which a file reaches LibTorch, or an empty list."""
    seen = set() if seen is None else seen
    seen.add(name)
    for header, _ in includes_of(name):
        if IS_TORCH.match(header):
            return [header]
        path = resolve(header, name)
        if path and path not in seen:
            chain = torch_chain(path, seen)
            if chain:
                return [header, *chain]
    return []


def library_problem(name, module, header):
    """Reason why a file must not include a library's header, or None."""
    if IS_TORCH.match(header):
        if name.startswith("kernels/") and not KERNEL_HOST.match(name):
            return "of the kernels only cuda_*.cpp may include LibTorch"
        if module not in TORCH:
            return f"{module} must not depend on LibTorch"
    if IS_LOCALIZATION_LIBRARY.match(header) and module not in LOCALIZATION_LIBRARIES:
        return f"{module} must not depend on Eigen, OpenCV or Ceres"
    return None


def problem(name, module, header):
    """Reason why a file of a module must not include the header, or None."""
    reason = library_problem(name, module, header)
    if reason or name.startswith("tests/"):
        return reason
    other = module_of(header)
    if header == FOR_MAPPING_HALF and module in MAPPING_HALF:
        return None
    if other and other not in reachable(module):
        return f"{module} must not depend on {other}"
    return None


def problems_of(name):
    module = module_of(name)
    if module is None and folder_of(name) and not name.startswith(("tests/", "scripts/")):
        yield f"{name}: add the module of this folder to {pathlib.Path(__file__).name}"
    for header, quoted in includes_of(name):
        reason = problem(name, module, header) if module else None
        if ".." in pathlib.PurePath(header).parts:
            reason = "paths start at include/, src/, tests/ or the root"
        elif quoted and header not in GENERATED and not resolve(header, name):
            reason = "there is no such header"
        elif name.startswith(("include/", "examples/")) and quoted and not header.startswith("apvi/"):
            reason = "public headers and examples must include public headers only"
        if reason:
            yield f"{name}: includes {header}, but {reason}"
    if name.endswith((".cu", ".cuh")):
        chain = torch_chain(name)
        if chain:
            yield f"{name}: reaches LibTorch: {' -> '.join(chain)}"


def unused_public_headers(names):
    """Public headers that only their own module and tests include, and that are not API."""
    api = {header for header, _ in includes_of(UMBRELLA)} | {UMBRELLA.removeprefix("include/")}
    used = {}
    for name in (name for name in names if not name.startswith("tests/") and name != UMBRELLA):
        for header, _ in includes_of(name):
            used.setdefault(header, set()).add(module_of(name) or name)
    for name in names:
        header = name.removeprefix("include/")
        if not name.startswith("include/") or header in api:
            continue
        if not used.get(header, set()) - {module_of(name)}:
            yield f"{name}: only {module_of(name)} includes it: move it to src/, or add it to {UMBRELLA}"


def undefined_in_public(names):
    """Types that a public header declares and no public header defines: users could not use them."""
    public = [name for name in names if name.startswith("include/")]
    texts = {name: (ROOT / name).read_text(encoding="utf-8") for name in public}
    defined = {match for text in texts.values() for match in DEFINITION.findall(text)}
    for name, text in texts.items():
        for declared in DECLARATION.findall(text):
            if declared not in defined:
                yield f"{name}: declares {declared}, which no public header defines: move it to src/"


def our_files():
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard",
               "*.hpp", "*.cpp", "*.cu", "*.cuh"]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return sorted({name for name in listed.stdout.split("\n") if name and (ROOT / name).is_file()})


def main():
    names = our_files()
    problems = [text for name in names for text in problems_of(name)]
    problems += [*unused_public_headers(names), *undefined_in_public(names)]
    print("\n".join(problems) or "layers: all includes respect the module dependencies")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
