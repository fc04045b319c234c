#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Measures localization with wrong calibration: benchmarks/perturbed_rigs.py WORK [--apvi FILE] [--draws N]

Simulates three dives whose camera is late, and localizes each with the true rig and with rigs that
are wrong: rotations of camera and DVL by 1 degree about random axes, lever arms by 3 cm in random
directions, focal length and speed of sound by 1 %, and latencies of camera and DVL that the rig
does not mention. Prints errors of the trajectories, and of the camera's calibration that was found.
Everything is made below WORK; what is there already is kept.
"""
import argparse
import concurrent.futures
import json
import math
import pathlib
import random

from relocalization import NO_TRUE_IMAGES, SMALL, call, settings

SCENES = pathlib.Path(__file__).resolve().parents[1] / "configs/scenes"
NAMES = ["seabed_easy", "ship_easy", "dam_easy"]
CAMERA_LATENCY_S = 0.05
ROTATION_DEG, LEVER_ARM_M, FOCAL, SOUND_SPEED = 1.0, 0.03, 0.01, 0.01


def value_of(rig, section, key):
    """An entry of rig.yaml as text."""
    lines = rig.split(f"\n{section}:\n")[1].splitlines()
    return next(line.split(":", 1)[1].strip() for line in lines if line.strip().startswith(key + ":"))


def numbers(text):
    return [float(x) for x in text.strip("[]").split(",")]


def direction(draw):
    v = [draw.gauss(0, 1) for _ in range(3)]
    n = math.hypot(*v)
    return [x / n for x in v]


def rotation(axis, angle):
    """Rodrigues' formula."""
    x, y, z = axis
    c, s, v = math.cos(angle), math.sin(angle), 1 - math.cos(angle)
    return [[c + x * x * v, x * y * v - z * s, x * z * v + y * s],
            [y * x * v + z * s, c + y * y * v, y * z * v - x * s],
            [z * x * v - y * s, z * y * v + x * s, c + z * z * v]]


def product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def matrix_of(text):
    m = numbers(text)
    return [m[0:3], m[4:7], m[8:11]], [m[3], m[7], m[11]]


def moved(text, draw):
    r, t = matrix_of(text)
    r = product(r, rotation(direction(draw), math.radians(ROTATION_DEG)))
    t = [a + LEVER_ARM_M * b for a, b in zip(t, direction(draw))]
    rows = [x for i in range(3) for x in (*r[i], t[i])] + [0, 0, 0, 1]
    return "[" + ", ".join(f"{x:.9g}" for x in rows) + "]"


def wrong_rig(rig, seed):
    draw = random.Random(seed)
    fx, fy, cx, cy = numbers(value_of(rig, "cam0", "intrinsics"))
    f = 1 + FOCAL * draw.choice((-1, 1))
    sound = float(value_of(rig, "dvl0", "sound_speed")) * (1 + SOUND_SPEED * draw.choice((-1, 1)))
    return [f"rig.cam0.T_body_sensor={moved(value_of(rig, 'cam0', 'T_body_sensor'), draw)}",
            f"rig.cam0.intrinsics=[{f * fx}, {f * fy}, {cx}, {cy}]", "rig.cam0.time_offset_s=0",
            f"rig.dvl0.T_body_sensor={moved(value_of(rig, 'dvl0', 'T_body_sensor'), draw)}",
            f"rig.dvl0.sound_speed={sound}", "rig.dvl0.time_offset_s=0"]


def angle_deg(a, b):
    trace = sum(a[i][k] * b[i][k] for i in range(3) for k in range(3))
    return math.degrees(math.acos(max(-1.0, min(1.0, (trace - 1) / 2))))


def calibration_errors(found, rig):
    r, t = matrix_of(value_of(found, "cam0", "T_body_sensor"))
    true_r, true_t = matrix_of(value_of(rig, "cam0", "T_body_sensor"))
    focal = numbers(value_of(found, "cam0", "intrinsics"))[0]
    true_focal = numbers(value_of(rig, "cam0", "intrinsics"))[0]
    offset = float(value_of(found, "cam0", "time_offset_s"))
    return {"camera_deg": angle_deg(r, true_r), "camera_m": math.dist(t, true_t),
            "focal_percent": 100 * abs(focal / true_focal - 1),
            "camera_ms": 1000 * abs(offset - float(value_of(rig, "cam0", "time_offset_s")))}


def localize(apvi, dive, run, extra):
    """Errors of the trajectories and of the calibration that was found."""
    rig = (dive / "truth/rig.yaml").read_text()
    if not (run / "metrics.json").exists():
        call(apvi, "run", dive, "-o", run, "--no-report", "--overwrite",
             *settings(["mapping.enabled=false", "run.threads=1", "run.mode=sequential", *extra]))
    metrics = json.loads((run / "metrics.json").read_text())
    row = {"odometry_m": metrics["trajectory"]["ate_rmse_m"],
           "odometry_deg": metrics["trajectory"]["rot_rmse_deg"],
           "smoothed_m": metrics["smoothed"]["ate_rmse_m"],
           "smoothed_deg": metrics["smoothed"]["rot_rmse_deg"]}
    if (run / "rig_estimated.yaml").exists():
        row.update(calibration_errors((run / "rig_estimated.yaml").read_text(), rig))
    return row


def measure(apvi, work, name, seed, extra, again):
    """Seed 0 is the true rig."""
    dive, run = work / name, work / "runs" / f"{name}_{seed}"
    wrong = wrong_rig((dive / "truth/rig.yaml").read_text(), seed) if seed else []
    row = localize(apvi, dive, run, [*wrong, *extra])
    if again and seed:
        second = localize(apvi, dive, run.with_name(run.name + "_again"),
                          [f"dataset.rig={run / 'rig_estimated.yaml'}", *extra])
        row.update({f"again {key}": value for key, value in second.items()})
    return row


def report(name, true, rows):
    print(f"{name}, {len(rows)} wrong rigs")
    for key in rows[0]:
        values = sorted(row[key] for row in rows if key in row)
        if values:
            of_true = f"   true rig {true[key]:.4f}" if key in true else ""
            print(f"  {key:20} median {values[len(values) // 2]:.4f}  largest {values[-1]:.4f}{of_true}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--apvi", default="apvi")
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--scenes", nargs="+", default=NAMES)
    parser.add_argument("--small", action="store_true", help="images of 320 x 240 at 10 Hz")
    parser.add_argument("--again", action="store_true",
                        help="run each wrong rig again with the calibration that was found")
    parser.add_argument("--set", action="append", default=[], help="a setting of all runs")
    a = parser.parse_args()
    for name in a.scenes:
        call(a.apvi, "sim", SCENES / f"{name}.yaml", "-o", a.work / name,
             *settings([*(SMALL if a.small else []), *NO_TRUE_IMAGES,
                        f"rig.cam0.time_offset_s={CAMERA_LATENCY_S}"]))
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        runs = {name: [pool.submit(measure, a.apvi, a.work, name, seed, a.set, a.again)
                       for seed in range(a.draws + 1)] for name in a.scenes}
        for name, rows in runs.items():
            true, *wrong = [row.result() for row in rows]
            report(name, true, wrong)


if __name__ == "__main__":
    main()
