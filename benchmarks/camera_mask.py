#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Measures what a mask is worth: benchmarks/camera_mask.py WORK [--apvi FILE] [--set KEY=VALUE ...]

Simulates a dive, and paints a gripper and an overlay with a clock into its images. Localizes and maps
the dive as it is, painted, and painted with the mask that `apvi camera mask` finds. Prints errors of
the trajectories, and of the maps against clean images from beside the path. Everything is made below
WORK; what is there already is kept. Requires python3-pil.
"""
import argparse
import json
import pathlib
import shutil

from PIL import Image, ImageDraw, ImageFont
from relocalization import SCENE, SMALL, call, settings

DURATION_S = 40
METRICS = {"odometry [m]": ("trajectory", "ate_rmse_m"), "smoothed [m]": ("smoothed", "ate_rmse_m"),
           "off the path [dB]": ("mapping", "off_path_psnr_db"),
           "held out [dB]": ("mapping", "psnr_db"),
           "image depth [m]": ("mapping", "depth_rmse_m"), "Gaussians": ("mapping", "gaussians")}


def paint(image, number):
    """A gripper with bolts and marks at the lower edge, text at the upper one."""
    w, h = image.size
    draw = ImageDraw.Draw(image)
    draw.polygon([(0.40 * w, h), (0.45 * w, 0.72 * h), (0.58 * w, 0.70 * h), (0.66 * w, h)],
                 fill=(190, 160, 40))
    for i in range(4):
        x, y = 0.47 * w + 0.03 * w * i, 0.78 * h + 0.05 * h * i
        draw.ellipse([x, y, x + 0.02 * w, y + 0.02 * w], fill=(30, 30, 30))
    draw.line([0.5 * w, 0.72 * h, 0.6 * w, h], fill=(90, 70, 20), width=max(1, w // 160))
    font = ImageFont.load_default()
    draw.text((0.03 * w, 0.03 * h), f"ROV 2  {number // 600:02}:{number // 10 % 60:02}.{number % 10}  REC",
              fill=(255, 255, 255), font=font)
    return image


def paint_dive(clean, painted):
    if painted.exists():
        return
    unfinished = painted.with_name(painted.name + ".part")
    shutil.rmtree(unfinished, ignore_errors=True)
    shutil.copytree(clean, unfinished)
    for number, file in enumerate(sorted((unfinished / "mav0/cam0/data").iterdir())):
        paint(Image.open(file).convert("RGB"), number).save(file)
    unfinished.rename(painted)


def run(apvi, dive, folder, extra):
    if not (folder / "metrics.json").exists():
        call(apvi, "run", dive, "-o", folder, "--no-report", "--overwrite",
             *settings(["run.mode=sequential", *extra]))
    return json.loads((folder / "metrics.json").read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--apvi", default="apvi")
    parser.add_argument("--set", action="append", default=[], help="a setting of all runs")
    a = parser.parse_args()
    clean, painted, mask = a.work / "clean", a.work / "painted", a.work / "mask.png"
    call(a.apvi, "sim", SCENE, "-o", clean,
         *settings([*SMALL, f"duration_s={DURATION_S}", "truth.mesh=false"]))
    paint_dive(clean, painted)
    call(a.apvi, "camera", "mask", painted, "-o", mask, "--preview", a.work / "preview.png")
    masked = [f"rig.cam0.mask={mask.resolve()}"]
    columns = {"clean": run(a.apvi, clean, a.work / "run_clean", a.set),
               "painted": run(a.apvi, painted, a.work / "run_painted", a.set),
               "with mask": run(a.apvi, painted, a.work / "run_masked", [*masked, *a.set])}
    print(f"{'':18}" + "".join(f"{name:>12}" for name in columns))
    for name, (section, key) in METRICS.items():
        values = [column.get(section, {}).get(key) for column in columns.values()]
        print(f"{name:18}" + "".join(f"{'-' if v is None else round(v, 4)!s:>12}" for v in values))


if __name__ == "__main__":
    main()
