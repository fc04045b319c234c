#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Measures relocalization on simulated dives: benchmarks/relocalization.py WORK [--apvi FILE] [--starts N]

Simulates a dive over a reef and later ones at the same place in other water and light, makes the
map of the first, and starts the others at many times of their first ten seconds. Prints how many
were found, after how long, and the errors against the truth: of the deciding image, and of the
smoothed trajectory. Everything is made below WORK; what is there already is kept.
"""
import argparse
import concurrent.futures
import json
import math
import pathlib
import subprocess

SCENE = pathlib.Path(__file__).resolve().parents[1] / "configs/scenes/seabed_easy.yaml"
SMALL = ["rig.cam0.resolution=[320, 240]", "rig.cam0.intrinsics=[210, 210, 159.5, 119.5]",
         "rig.cam0.rate_hz=10"]
NO_TRUE_IMAGES = ["truth.image_every=0", "truth.mesh=false"]
CAMERA = SMALL + NO_TRUE_IMAGES
FIRST = ["duration_s=90"]
LATER = {
    "turbid_day": ["duration_s=24", "sensor_seed=77", "water.type=3C", "water.attenuation_length_m=4",
                   "light.sun_elevation_deg=48", "light.sun_azimuth_deg=200", "light.caustics=0.05",
                   "motion.origin=[-3.9, -1.9, -7.1]", "motion.altitude_m=1.6",
                   "motion.heading_deg=12"],
    "lamp": ["duration_s=24", "sensor_seed=78", "water.type=5C", "water.attenuation_length_m=2.5",
             "water.snow.density_per_m3=150", "light.daylight=0.4", "light.caustics=0",
             "light.lamp={intensity: 1.0}", "motion.origin=[-4.2, -0.3, -7.1]",
             "motion.altitude_m=1.5", "motion.heading_deg=-6"],
}
RUN_S = 8.0  # of each start
LIMITS = {"time_s": 5.0, "position_m": 0.03, "rotation_deg": 0.5, "wrong_m": 0.3}


def call(*command):
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(map(str, command))}\n{done.stderr[-2000:]}")


def settings(values):
    return [word for value in values for word in ("--set", value)]


def read_tum(path):
    rows = [line.split() for line in path.read_text().splitlines() if line and line[0] != "#"]
    return [(round(float(r[0]) * 1e9), [float(x) for x in r[1:4]], [float(x) for x in r[4:8]])
            for r in rows]


def rotate(q, v):
    x, y, z, w = q
    u = (y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0])
    return [v[i] + 2 * (w * u[i] + (y * u[2] - z * u[1], z * u[0] - x * u[2], x * u[1] - y * u[0])[i])
            for i in range(3)]


def angle_deg(a, b):
    return 2 * math.degrees(math.acos(min(1.0, abs(sum(x * y for x, y in zip(a, b))))))


def times(p, q):
    (x, y, z, w), (a, b, c, d) = p, q
    return [w * a + x * d + y * c - z * b, w * b - x * c + y * d + z * a,
            w * c + x * b - y * a + z * d, w * d - x * a - y * b - z * c]


def at(trajectory, stamp):
    """The pose of the nearest stamp; the truth has the rate of the IMU."""
    low, high = 0, len(trajectory) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if trajectory[middle][0] < stamp else (low, middle)
    before = trajectory[max(0, low - 1)]
    return min(before, trajectory[low], key=lambda pose: abs(pose[0] - stamp))


class Alignment:
    """The rotation about z and the translation from an estimate to the truth, by least squares."""

    def __init__(self, estimate, truth):
        pairs = [(p, at(truth, t)[1]) for t, p, _ in estimate]
        n = len(pairs)
        a = [sum(e[i] for e, _ in pairs) / n for i in range(3)]
        b = [sum(t[i] for _, t in pairs) / n for i in range(3)]
        sine = sum((e[0] - a[0]) * (t[1] - b[1]) - (e[1] - a[1]) * (t[0] - b[0]) for e, t in pairs)
        cosine = sum((e[0] - a[0]) * (t[0] - b[0]) + (e[1] - a[1]) * (t[1] - b[1]) for e, t in pairs)
        half = 0.5 * math.atan2(sine, cosine)
        self.q = [0.0, 0.0, math.sin(half), math.cos(half)]
        turned = rotate(self.q, a)
        self.t = [b[i] - turned[i] for i in range(3)]

    def errors(self, position, rotation, truth_position, truth_rotation):
        moved = rotate(self.q, position)
        return (math.dist([moved[i] + self.t[i] for i in range(3)], truth_position),
                angle_deg(times(self.q, rotation), truth_rotation))


def camera_pose(rig, body):
    """From a pose of the body, by the extrinsics of rig.yaml."""
    line = rig.split("cam0:")[1].split("T_body_sensor:")[1]
    m = [float(x) for x in line[line.index("[") + 1:line.index("]")].split(",")]
    w = 0.5 * math.sqrt(max(1e-12, 1 + m[0] + m[5] + m[10]))
    if w > 1e-3:
        q = [(m[9] - m[6]) / (4 * w), (m[2] - m[8]) / (4 * w), (m[4] - m[1]) / (4 * w), w]
    else:
        raise ValueError("a camera turned by 180 degrees")
    _, p, r = body
    arm = rotate(r, [m[3], m[7], m[11]])
    return [p[i] + arm[i] for i in range(3)], times(r, q)


def measure(apvi, work, name, start_s, alignment):
    dive, run = work / name, work / "runs" / f"{name}_{start_s:.1f}"
    if not (run / "metrics.json").exists():
        call(apvi, "run", dive, "--map", work / "runs" / "first", "-o", run, "--no-report", "--overwrite",
             *settings([f"dataset.start_s={start_s}", f"dataset.duration_s={RUN_S}",
                        "mapping.enabled=false", "run.threads=1"]))
    result = json.loads((run / "metrics.json").read_text())["relocalization"]
    row = {"name": name, "start_s": start_s, "found": result["found"]}
    if not result["found"]:
        return row
    truth = read_tum(dive / "truth/trajectory.tum")
    pose = result["T_map_camera"]
    true = camera_pose((dive / "truth/rig.yaml").read_text(), at(truth, result["image_stamp_ns"]))
    row["time_s"] = result["found_after_s"]
    row["first_m"], row["first_deg"] = alignment.errors(pose["position_m"], pose["rotation_xyzw"], *true)
    row["sigma_m"] = math.hypot(math.sqrt(2) * result["sigma"]["horizontal_m"],
                                result["sigma"]["vertical_m"])
    smoothed = [alignment.errors(p, q, *at(truth, t)[1:])
                for t, p, q in read_tum(run / "trajectory_smoothed.tum")]
    row["smoothed_m"], row["smoothed_deg"] = (
        math.sqrt(sum(e[i] ** 2 for e in smoothed) / len(smoothed)) for i in range(2))
    return row


def quantile(values, part):
    values = sorted(values)
    return values[min(len(values) - 1, int(part * len(values)))]


def report(name, rows):
    found = [r for r in rows if r["found"]]
    in_time = [r for r in found if r["time_s"] <= LIMITS["time_s"]]
    print(f"{name}: {len(rows)} starts, {100 * len(found) / len(rows):.0f} % found, "
          f"{100 * len(in_time) / len(rows):.0f} % within {LIMITS['time_s']:g} s")
    if not found:
        return
    for key, unit in (("time_s", "s"), ("first_m", "m"), ("first_deg", "deg"), ("sigma_m", "m"),
                      ("smoothed_m", "m"), ("smoothed_deg", "deg")):
        values = [r[key] for r in found]
        print(f"  {key:12} median {quantile(values, 0.5):.3f}  p95 {quantile(values, 0.95):.3f}  "
              f"largest {max(values):.3f} {unit}")
    good = [r for r in in_time if r["smoothed_m"] <= LIMITS["position_m"]
            and r["smoothed_deg"] <= LIMITS["rotation_deg"]]
    wrong = [r for r in found if max(r["first_m"], r["smoothed_m"]) > LIMITS["wrong_m"]]
    print(f"  {100 * len(good) / len(rows):.0f} % in time and smoothed within {LIMITS['position_m']:g} m, "
          f"{LIMITS['rotation_deg']:g} deg; {len(wrong)} wrong by more than {LIMITS['wrong_m']:g} m")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--apvi", default="apvi")
    parser.add_argument("--scene", default=SCENE)
    parser.add_argument("--starts", type=int, default=25, help="of each later dive")
    parser.add_argument("--jobs", type=int, default=1)
    a = parser.parse_args()
    for name, values in {"first": FIRST, **LATER}.items():
        call(a.apvi, "sim", a.scene, "-o", a.work / name, *settings(CAMERA + values))
    first = a.work / "runs" / "first"
    if not (first / "places.bin").exists():
        call(a.apvi, "run", a.work / "first", "-o", first, "--no-report", "--overwrite",
             *settings(["mapping.enabled=false"]))
    alignment = Alignment(read_tum(first / "trajectory_smoothed.tum"),
                          read_tum(a.work / "first/truth/trajectory.tum"))
    starts = [10.0 * k / a.starts for k in range(a.starts)]
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        for name in LATER:
            rows = pool.map(lambda s, n=name: measure(a.apvi, a.work, n, s, alignment), starts)
            report(name, list(rows))


if __name__ == "__main__":
    main()
