# SPDX-License-Identifier: BSD-3-Clause
"""Tables of the metrics in metrics.json."""

# key: (name, unit, digits after the point; None for a whole number)
TRAJECTORY = {
    "ate_rmse_m": ("Absolute position error, RMSE", "m", 3),
    "ate_mean_m": ("… mean", "m", 3),
    "ate_median_m": ("… median", "m", 3),
    "ate_std_m": ("… standard deviation", "m", 3),
    "ate_min_m": ("… smallest", "m", 3),
    "ate_max_m": ("… largest", "m", 3),
    "ate_first_pose_rmse_m": ("… RMSE, aligned at the first pose", "m", 3),
    "ate_percent_of_path": ("Absolute position error, relative to the path length", "%", 3),
    "rot_rmse_deg": ("Rotation error, RMSE", "°", 2),
    "rpe_1s_rmse_m": ("Relative error over 1 s, RMSE", "m", 3),
    "rpe_10m_rmse_m": ("Relative error over 10 m, RMSE", "m", 3),
    "rpe_10m_mean_m": ("… mean", "m", 3),
    "rpe_10m_median_m": ("… median", "m", 3),
    "rpe_10m_all_pairs_rmse_m": ("… RMSE over all pairs", "m", 3),
    "coverage": ("Coverage of the reference", "%", 1),
    "path_length_m": ("Length of the reference path", "m", 1),
    "estimate_length_m": ("Length of the estimated path", "m", 1),
    "end_to_start_m": ("Distance from start to end", "m", 2),
    "matched": ("Matched poses", "", None),
}
OTHERS = {
    "scale.source": ("Source of the scale", "", None),
    "scale.known": ("Distances are in meters", "", None),
    "speed.wall_s": ("Computing time", "s", 2),
    "speed.sequence_s": ("Length of the recording", "s", 1),
    "speed.realtime_factor": ("Real-time factor", "", 0),
    "speed.tracking_fps": ("Tracked images per second", "1/s", 1),
    "speed.render_fps": ("Rendered images per second", "1/s", 1),
    "speed.iterations_per_s": ("Optimization steps per second", "1/s", 1),
    "speed.rss_peak_mib": ("Peak memory", "MiB", 1),
    "speed.gpu_peak_mib": ("Peak GPU memory", "MiB", 1),
    "counts.imu_gaps": ("Gaps in the IMU data", "", None),
    "counts.zero_velocity_updates": ("Zero-velocity updates", "", None),
    "smoothed.closed_loops": ("Loop closures of the trajectory", "", None),
    "smoothed.rejected_loops": ("… rejected by the graph", "", None),
    "smoothed.largest_correction_m": ("Largest correction of a pose", "m", 3),
    "smoothed.largest_correction_deg": ("… of its rotation", "°", 2),
    "smoothed.keyframe_ms.median": ("Pose graph: time per keyframe, median", "ms", 1),
    "smoothed.keyframe_ms.p95": ("… 95 % quantile", "ms", 1),
    "vio.init_time_s": ("VIO: time to initialize", "s", 2),
    "vio.failures": ("VIO: failures", "", None),
    "vio.freeze_frames": ("VIO: frozen frames", "", None),
    "vio.drop_frames": ("VIO: dropped frames", "", None),
    "mapping.psnr_db": ("Held-out views: PSNR", "dB", 2),
    "mapping.ssim": ("Held-out views: SSIM", "", 3),
    "mapping.lpips": ("Held-out views: LPIPS", "", 3),
    "mapping.ms_ssim": ("Held-out views: MS-SSIM", "", 3),
    "mapping.psnr_median_image_db": ("PSNR of the median-image baseline", "dB", 2),
    "mapping.psnr_all_keyframes_db": ("All keyframes: PSNR", "dB", 2),
    "mapping.restored_psnr_db": ("Restored views: PSNR", "dB", 2),
    "mapping.restored_seen_psnr_db": ("Restored views, visible parts: PSNR", "dB", 2),
    "mapping.range_bias.image_per_m": ("Range bias of the images (red, green, blue)", "1/m", 3),
    "mapping.range_bias.restored_per_m": ("Range bias of restored images", "1/m", 3),
    "mapping.depth_rmse_m": ("Depth error of the map, RMSE", "m", 3),
    "mapping.depth_seen_rmse_m": ("Depth error of the map, visible parts, RMSE", "m", 3),
    "mapping.depth_half_pixel_rmse_m": ("Depth error of a perfect map shifted by half a pixel, RMSE", "m", 3),
    "mapping.depth_abs_rel": ("Depth error of the map, relative", "", 4),
    "mapping.gaussians": ("Gaussians", "", None),
    "mapping.iterations": ("Optimization steps", "", None),
    "mapping.heldout_views": ("Held-out views", "", None),
    "speed.training_s": ("Training time of the map", "s", 1),
    "vio.resets": ("VIO: resets", "", None),
    "vio.success": ("VIO: recovered from every failure", "", None),
    "counts.abandoned_frames": ("Images abandoned (too late)", "", None),
    "counts.imu_saturated": ("Saturated IMU samples", "", None),
    "medium.error_percent": ("Medium: error of the coefficients", "%", 0),
    "mapping.lpips_net": ("LPIPS network", "", None),
    "build.backend": ("Backend", "", None),
    "build.torch": ("LibTorch", "", None),
    "build.git": ("Revision", "", None),
}
ESTIMATORS = {"smoothed": "Smoothed", "dipo": "DIPO", "vio": "VIO"}


def number(value, digits):
    """Formats a value as text, with thin spaces between thousands."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(number(item, 3) for item in value) or "none"
    if not isinstance(value, (int, float)):
        return str(value)
    if digits is None:
        return f"{value:,.0f}".replace(",", " ") if float(value).is_integer() else f"{value:.4g}"
    return f"{value:,.{digits}f}".replace(",", " ")


def trajectory_value(metrics, key):
    if key not in metrics:
        return ""
    value = 100.0 * metrics[key] if key == "coverage" else metrics[key]
    return number(value, TRAJECTORY[key][2])


def trajectory_columns(metrics):
    """Name and metrics of each estimator, without those identical to the fused trajectory."""
    fused = {key: value for key, value in metrics.items() if not isinstance(value, dict)}
    found = [(name, metrics[key]) for key, name in ESTIMATORS.items()
             if isinstance(metrics.get(key), dict) and metrics[key] != fused]
    return [("Estimate", fused), *found]


def trajectory_table(run):
    """Headings and rows (name, unit, values...); empty without metrics."""
    smoothed = {"smoothed": run.metrics["smoothed"]} if "smoothed" in run.metrics else {}
    columns = trajectory_columns({**run.metrics.get("trajectory", {}), **smoothed})
    rows = [(name, unit, [trajectory_value(figures, key) for _, figures in columns])
            for key, (name, unit, _) in TRAJECTORY.items() if any(key in f for _, f in columns)]
    return [name for name, _ in columns], rows


def count_rows(run):
    """(sensor, verdict or reason, count, percent) of the measurements."""
    rows = []
    for sensor in ("dvl", "depth"):
        counts = run.metrics.get("counts", {}).get(sensor, {})
        total = sum(counts.values())
        rows += [("DVL pings" if sensor == "dvl" else "Depth samples", verdict.replace("_", " "),
                  number(count, None), number(100.0 * count / total, 1))
                 for verdict, count in sorted(counts.items(), key=lambda item: -item[1])]
    return rows


def dropped_rows(run):
    """(stream, count) of samples that never reached the estimator."""
    dropped = dict(run.metrics.get("counts", {}).get("dropped_samples", {}))
    dropped.update(run.metrics.get("dropped", {}))
    return [(name.upper() if name in ("imu", "dvl") else name, number(count, None))
            for name, count in dropped.items()]


def warnings(run):
    """Sensors that did not serve and implausible results, as text."""
    found = run.metrics.get("warnings", [])
    return [str(text) for text in found] if isinstance(found, list) else []


def flatten(metrics, prefix=""):
    for key, value in metrics.items():
        if isinstance(value, dict):
            yield from flatten(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def other_rows(run):
    """(name, unit, value) of all other metrics; keys without an entry in OTHERS are shown as is."""
    shown = ("warnings", "trajectory.", "counts.dvl.", "counts.depth.", "counts.dropped_samples.", "dropped.")
    rows = []
    flat = dict(flatten(run.metrics))
    for key in sorted(flat, key=lambda k: list(OTHERS).index(k) if k in OTHERS else len(OTHERS)):
        is_in_table = key.startswith("smoothed.") and key.removeprefix("smoothed.") in TRAJECTORY
        if not key.startswith(shown) and not is_in_table:
            name, unit, digits = OTHERS.get(key, (key, "", None))
            rows.append((name, unit, number(flat[key], digits)))
    return rows


def headline(run):
    """(value, unit, label) of the most important metrics."""
    flat = dict(flatten(run.metrics))
    wanted = [("trajectory.ate_rmse_m", "m", "position error (RMSE)", 2),
              ("smoothed.ate_rmse_m", "m", "with loops closed", 2),
              ("trajectory.ate_percent_of_path", "%", "of the path", 2),
              ("trajectory.rot_rmse_deg", "°", "rotation error (RMSE)", 2),
              ("trajectory.end_to_start_m", "m", "from start to end", 2),
              ("trajectory.estimate_length_m", "m", "traveled", 0),
              ("mapping.psnr_db", "dB", "PSNR of held-out views", 1),
              ("speed.sequence_s", "s", "recorded", 0),
              ("speed.realtime_factor", "×", "real time", 0)]
    if "trajectory.ate_rmse_m" in flat:
        flat.pop("trajectory.end_to_start_m", None)
    return [(number(flat[key], digits_for(flat[key], digits)), unit, label)
            for key, unit, label, digits in wanted if key in flat]


def digits_for(value, digits):
    """Adds a digit to small numbers, so that 0.0057 is not shown as 0.01."""
    small = 0.0 < abs(value) < 2.0 * 10.0**-digits
    return digits + (2 if digits == 0 else 1) if small else digits
