#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Runs a fixed set of commands and records hashes of what they write.

A change that must not change results is checked with two calls:
  scripts/fingerprint.py PROGRAM_BEFORE -o before.json
  scripts/fingerprint.py PROGRAM_AFTER -o after.json --compare before.json
The recordings are looked for in APVI_TEST_DATA; cases whose recording is absent are skipped and named.
Hashes are those of one machine: LibTorch's sums depend on the processor.
"""
import argparse
import hashlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
POSES = ["trajectory.tum", "trajectory_smoothed.tum", "dipo.tum", "vio.tum", "health.csv"]
MAP = ["map.ply", "medium.json", "keyframes.tum", "renders/*"]
SMALL_DIVE = ["--set", "duration_s=20", "--set", "rig.cam0.resolution=[320, 240]",
              "--set", "rig.cam0.intrinsics=[210, 210, 159.5, 119.5]"]
# Keys of metrics.json that hold times, memory and versions. All others are results, seconds included.
VOLATILE = {"speed", "build"}
# Cases that map the dive of the case "simulation".
MAPS = {"online_map", "default_map", "paper_map"}


def cases(data, work):
    """Name, recording needed, arguments, files that are hashed."""
    config = ROOT / "configs"

    def dataset(name):
        return ["--set", f"dataset.path={data / name}"]

    dive = ["--set", f"dataset.path={work / 'simulation'}"]
    short = [*dive, "--set", "dataset.duration_s=10", "--set", "mapping.max_gaussians=30000"]
    euroc = config / "datasets/euroc_apvi.yaml"
    return [
        ("euroc_dvl", data / "euroc_mh01_apvi", ["run", euroc, *dataset("euroc_mh01_apvi")], POSES),
        ("euroc_camera", data / "euroc_mh01_apvi",
         ["run", euroc, *dataset("euroc_mh01_apvi"), "--set", "sensors.use=[camera, imu]"], POSES),
        ("akit", data / "akit_01", ["run", config / "datasets/akit.yaml", *dataset("akit_01")], POSES),
        ("posed_map", data / "euroc_v101_posed",
         ["run", config / "datasets/euroc_posed.yaml", *dataset("euroc_v101_posed"), "--set",
          "mapping.iterations=500", "--set", "mapping.time_budget_s=0"], MAP),
        ("render", data / "splat_reference",
         ["render", data / "splat_reference/garden.ply", "--camera",
          data / "splat_reference/camera.json", "--float"], ["*.pfm", "*.png"]),
        ("simulation", None,
         ["sim", config / "scenes/seabed_easy.yaml", *SMALL_DIVE], ["**/*"]),
        ("online_map", None, ["run", config / "experiments/seabed_online.yaml", *dive, "--set",
                              "mapping.time_budget_s=0", "--set", "mapping.final_iterations=200"],
         POSES + MAP),
        ("default_map", None, ["run", config / "default.yaml", *short], POSES + MAP),
        ("paper_map", None, ["run", config / "paper.yaml", *short], POSES + MAP),
    ]


def digest(path):
    if path.name == "metrics.json":
        text = json.dumps(stable(json.loads(path.read_text())), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()
    return hashlib.sha256(path.read_bytes()).hexdigest()


def stable(value):
    if isinstance(value, dict):
        return {key: stable(item) for key, item in value.items() if key not in VOLATILE}
    return value


def hashes(folder, patterns):
    files = sorted({path for pattern in [*patterns, "metrics.json"] for path in folder.glob(pattern)
                    if path.is_file()})
    return {str(path.relative_to(folder)): digest(path) for path in files}


def run_case(program, work, case):
    name, needed, arguments, patterns = case
    if needed is not None and not needed.is_dir():
        print(f"{name}: skipped, {needed} is not there", file=sys.stderr)
        return None
    folder = work / name
    command = [program, *map(str, arguments), "-o", str(folder)]
    result = subprocess.run(command, cwd=work, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise SystemExit(f"{name}: {' '.join(command)}\n{result.stderr[-2000:]}")
    print(f"{name}: done", file=sys.stderr)
    return hashes(folder, patterns)


def record(program, data, work, only):
    """The dive of the case "simulation" is what MAPS map, so it is made for each of them."""
    wanted = set(only)
    if wanted & MAPS:
        wanted.add("simulation")
    found = {}
    for case in cases(data, work):
        if not wanted or case[0] in wanted:
            found[case[0]] = run_case(program, work, case)
    return {name: value for name, value in found.items() if value is not None}


def not_compared(before, after):
    """Names of the cases that only one side has."""
    return sorted(set(before) ^ set(after))


def differences(before, after):
    lines = []
    for name in sorted(set(before) & set(after)):
        for file in sorted(set(before[name]) | set(after[name])):
            if before[name].get(file) != after[name].get(file):
                lines.append(f"{name}: {file}")
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("program", help="the apvi program")
    parser.add_argument("-o", "--output", required=True, type=pathlib.Path)
    parser.add_argument("--compare", type=pathlib.Path, help="hashes recorded before")
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args()
    data = pathlib.Path(os.environ.get("APVI_TEST_DATA", ROOT / "data")).resolve()
    with tempfile.TemporaryDirectory() as work:
        program = str(pathlib.Path(arguments.program).resolve())
        found = record(program, data, pathlib.Path(work), arguments.only)
    arguments.output.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n")
    if arguments.compare is None:
        return 0
    before = json.loads(arguments.compare.read_text())
    for name in not_compared(before, found):
        print(f"not compared: {name}")
    changed = differences(before, found)
    print("\n".join(changed) or f"the same in all {len(set(before) & set(found))} cases")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
