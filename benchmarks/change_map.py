#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Measures change maps on simulated dives: benchmarks/change_map.py WORK [--apvi FILE] [--set KEY=VALUE]

Simulates two dives over a reef, between which objects appear, vanish, move and change color, maps
both, and compares the maps. Prints which of the planted changes were found, those that no planted
one explains, and recall, precision and false changes per 100 m². Planted changes that fewer than
three keyframes of a dive have in the image are not counted: they are unknown. Everything is made
below WORK; what is there already is kept.
"""
import argparse
import json
import math
import pathlib

from relocalization import Alignment, call, camera_pose, read_tum, rotate, settings

SCENES = pathlib.Path(__file__).resolve().parent / "scenes"
DIVES = {"first": "reef_first.yaml", "later": "reef_later.yaml"}
RUN = ["run.mode=sequential", "run.threads=1", "mapping.online.steps_per_keyframe=10",
       "mapping.final_iterations=1500"]
MARGIN_M = 0.1   # around the box of a planted change
MIN_VIEWS = 3
RANGE_M = 4.0


def numbers(text, key):
    line = text.split("cam0:")[1].split(f"{key}:")[1]
    return [float(x) for x in line[line.index("[") + 1:line.index("]")].split(",")]


def views_of(dive, keyframes, truth, point):
    """How many keyframes have the point in the middle nine tenths of their image."""
    rig = (dive / "truth/rig.yaml").read_text()
    fx, fy, cx, cy = numbers(rig, "intrinsics")
    width, height = numbers(rig, "resolution")
    by_stamp = {t: (t, p, q) for t, p, q in truth}
    count = 0
    for stamp, _, _ in keyframes:
        body = by_stamp.get(stamp) or min(truth, key=lambda pose, s=stamp: abs(pose[0] - s))
        position, q = camera_pose(rig, body)
        x, y, z = rotate([-q[0], -q[1], -q[2], q[3]], [point[i] - position[i] for i in range(3)])
        if 0.0 < z < RANGE_M and abs(fx * x / z + cx - width / 2) < 0.45 * width \
                and abs(fy * y / z + cy - height / 2) < 0.45 * height:
            count += 1
    return count


def planted(first, later):
    """(kind, name, low, high) of all planted changes."""
    before, after = (json.loads((dive / "truth/objects.json").read_text()) for dive in (first, later))
    old, new = ({o["name"]: o for o in content["objects"]} for content in (before, after))
    moved = {name for name in old.keys() & new.keys()
             if math.dist(old[name]["center"], new[name]["center"]) > 0.05}
    rows = [("vanished", o) for name, o in old.items() if name not in new or name in moved]
    rows += [("appeared", o) for name, o in new.items() if name not in old or name in moved]
    known = {disc["name"] for disc in before["recolored"]}
    rows += [("color", disc) for disc in after["recolored"] if disc["name"] not in known]
    return [(kind, o["name"], o["min"], o["max"]) for kind, o in rows]


def explains(change, center, kind, low, high):
    inside = all(low[i] - MARGIN_M <= center[i] <= high[i] + MARGIN_M for i in range(2))
    return inside and (kind is None or change["kind"] == kind)


def report(work, content, alignment, truth_rows):
    changes = [(c, [a + b for a, b in zip(rotate(alignment.q, c["center_m"]), alignment.t)])
               for c in content["changes"]]
    seen = found = as_planted = 0
    for kind, name, low, high, views in truth_rows:
        hit = [c for c, center in changes if explains(c, center, None, low, high)]
        known = min(views) >= MIN_VIEWS
        seen += known
        found += known and bool(hit)
        as_planted += known and any(c["kind"] == kind for c in hit)
        names = ", ".join(f"{c['kind']} no. {c['id']}" for c in hit)
        state = f"listed as {names}" if hit else "MISSED" if known else "unknown"
        size = max(high[i] - low[i] for i in range(2))
        print(f"  {kind:9} {name:14} {size:.2f} m  views {views[0]:3} {views[1]:3}  {state}")
    false = [(c, center) for c, center in changes
             if not any(explains(c, center, None, low, high) for _, _, low, high, _ in truth_rows)]
    for c, (x, y, z) in false:
        print(f"  FALSE {c['kind']:9} no. {c['id']} at {x:.2f} {y:.2f} {z:.2f}, {c['length_m']:.2f} m long, "
              f"confidence {c['confidence']:.2f}")
    area = content["compared_m2"]
    print(f"{work}: {found} of {seen} planted changes listed ({100 * found / max(1, seen):.0f} %), "
          f"{as_planted} with their kind, "
          f"{len(changes) - len(false)} of {len(changes)} listed ones are true, "
          f"{100 * len(false) / max(1e-9, area):.1f} false per 100 m² on {area:.0f} m²")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--apvi", default="apvi")
    parser.add_argument("--min-size", type=float, default=0.1, help="of apvi diff [m]")
    parser.add_argument("--set", action="append", default=[], help="a setting of both runs")
    a = parser.parse_args()
    dives = {name: a.work / name for name in DIVES}
    runs = {name: a.work / "runs" / name for name in DIVES}
    for name, scene in DIVES.items():
        if not (dives[name] / "truth/objects.json").exists():
            call(a.apvi, "sim", SCENES / scene, "-o", dives[name])
        if not (runs[name] / "map.ply").exists():
            known = [] if name == "first" else ["--map", runs["first"]]
            call(a.apvi, "run", dives[name], *known, "-o", runs[name], "--no-report", "--overwrite",
                 *settings(RUN + a.set))
    out = a.work / "changes"
    call(a.apvi, "diff", runs["first"], runs["later"], "-o", out, "--overwrite", "--min-size", a.min_size)
    truths = {name: read_tum(dives[name] / "truth/trajectory.tum") for name in DIVES}
    keyframes = {name: read_tum(runs[name] / "keyframes.tum") for name in DIVES}
    alignment = Alignment(keyframes["first"], truths["first"])
    rows = []
    for kind, name, low, high in planted(dives["first"], dives["later"]):
        center = [0.5 * (x + y) for x, y in zip(low, high)]
        views = [views_of(dives[d], keyframes[d], truths[d], center) for d in DIVES]
        rows.append((kind, name, low, high, views))
    report(a.work, json.loads((out / "changes.json").read_text()), alignment, rows)


if __name__ == "__main__":
    main()
