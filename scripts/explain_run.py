#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Prints the most important metrics of a run with explanations: explain_run.py RUN."""
import json
import pathlib
import sys


def lookup(metrics, name):
    for key in name.split("."):
        metrics = metrics.get(key) if isinstance(metrics, dict) else None
    return metrics


def trajectory_lines(get):
    ate = get("trajectory.ate_rmse_m")
    if ate is None:
        return
    length, percent = get("trajectory.path_length_m"), get("trajectory.ate_percent_of_path")
    yield f"{ate:.3f} m", f"position error: RMSE against the aligned reference over {length:.1f} m of path ({percent:.2f} %)"
    if get("trajectory.vio.ate_rmse_m") is not None and get("trajectory.dipo.ate_rmse_m") is not None:
        yield (f"{get('trajectory.dipo.ate_rmse_m'):.3f} m",
               "position error from DVL, IMU and pressure only, without the camera")
    yield f"{100 * get('trajectory.coverage'):.0f} %", "of the reference trajectory is covered"


def vision_lines(get):
    failures = get("vio.failures")
    if failures is None:
        return
    times = get("vio.reinit_times_s") or []
    recovery = f", recovered at most {max(times):.1f} s after images were usable again" if times else ""
    fallback = "; DVL and pressure provided the pose meanwhile" if failures else ""
    yield f"{failures}", f"vision failures{recovery}{fallback}"


def map_lines(get):
    psnr = get("mapping.psnr_db")
    if psnr is None:
        return
    control = get("mapping.psnr_median_image_db")
    baseline = f"; median-image baseline: {control:.1f} dB" if control is not None else ""
    yield f"{psnr:.1f} dB", f"PSNR of {get('mapping.heldout_views')} held-out views{baseline}"
    yield f"{get('mapping.gaussians'):,}", "Gaussians in map.ply, for any Gaussian splatting viewer"
    if get("mapping.depth_abs_rel") is not None:
        yield f"{100 * get('mapping.depth_abs_rel'):.1f} %", "mean relative depth error of the map"
    if get("medium.error_percent") is not None:
        yield (f"{get('medium.error_percent'):.0f} %",
               "error of the water coefficients; if large, the colors of water-free views are wrong")


def lines(metrics):
    def get(name):
        return lookup(metrics, name)
    yield from trajectory_lines(get)
    yield from vision_lines(get)
    yield from map_lines(get)
    if get("speed.wall_s") is not None:
        yield f"{get('speed.wall_s'):.0f} s", f"computing time for {get('speed.sequence_s'):.0f} s of recording"


def main():
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        print(__doc__.strip(), file=sys.stderr)
        return 2
    path = pathlib.Path(sys.argv[1]) / "metrics.json"
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError) as error:
        print(f"explain_run.py: {path}: {error}", file=sys.stderr)
        return 2
    for value, text in lines(metrics):
        print(f"  {value:>9}  {text}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
