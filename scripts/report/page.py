# SPDX-License-Identifier: BSD-3-Clause
"""Assembles the report page of a run."""
import dataclasses
import datetime

from . import figures, map_figures, metrics_table, sensor_figures, style, template, vision_figures
from .alignment import compare

EPOCH_PLAUSIBLE_S = 1e9  # smaller stamps are not Unix time


@dataclasses.dataclass
class Section:
    title: str
    plots: list = dataclasses.field(default_factory=list)
    note: str = ""
    views: list = dataclasses.field(default_factory=list)  # held-out views of the map
    rows: list = dataclasses.field(default_factory=list)   # (label, count) of a small table


def trajectory_section(run, comparison):
    if len(run.estimate) < 2:
        return Section("Trajectory", note="The run has fewer than two poses.")
    caption = "Top view of the path."
    if comparison:
        caption += f" Estimate and reference are {comparison.alignment}."
    depth = "Depth over time."
    if comparison and run.reference.planar:
        depth = "Depth over time, of the estimate only: the reference has no heights."
    elif comparison:
        depth = "Depth over time; all trajectories are aligned."
    return Section("Trajectory", [
        template.plot(lambda: figures.plan(run, comparison), "top view of the path", caption),
        template.plot(lambda: figures.profile(run, comparison), "depth over time", depth)],
                   run.reference_note)


def error_section(run, comparison):
    if comparison is None:
        return None
    caption = (f"Distance from the reference at {len(comparison.t)} common stamps, RMSE "
               f"{comparison.rmse:.3g} m, the trajectories {comparison.alignment}. Dashed: standard "
               "deviation of DIPO over all axes, relative to its start; the alignment distributes "
               "the error over the run, so the two need not match at the beginning.")
    _, sigma, _ = figures.expected_error(run, comparison.axes)
    if len(sigma) > 0:
        caption += f" DIPO's sigma at the end is {sigma[-1]:.2g} m."
    if figures.pose_intervals(run):
        caption += " Background colors: pose source of each frame."
    return Section("Error over time", [template.plot(
        lambda: figures.error(run, comparison), "error over time", caption)])


def vision_section(run, _):
    if not vision_figures.has_features(run):
        return None
    plots = [
        template.plot(lambda: vision_figures.verdicts(run), "verdicts over time",
                         "Pose source of each frame: fused with vision, from DVL and pressure while "
                         "vision fails (frozen: the window is kept), or dropped."),
        template.plot(lambda: vision_figures.features(run), "features over time",
                         "Corners in the image, stable tracks, and landmarks in the solution"
                         + ("; below, the eigenvalues of the information matrix of the newest "
                            "pose, with the threshold of the discriminator."
                            if vision_figures.has_eigenvalues(run) else "."))]
    frames = len(run.health)
    rows = [(label, f"{count} of {frames}") for label, count in vision_figures.reason_rows(run)]
    return Section("Vision", plots, rows=rows)


def timing_section(run, _):
    if not vision_figures.stage_times(run):
        return None
    return Section("Computing time", [template.plot(
        lambda: vision_figures.timing(run), "histogram of computing times",
        "Time per camera frame; the last bin includes all slower frames.")])


def nis_section(run, _):
    if run.pings is None or "nis" not in run.pings or len(sensor_figures.pings_with_nis(run)[0]) == 0:
        return None
    inside, above, below = sensor_figures.band_fractions(run)
    caption = (f"Normalized innovation squared of every DVL ping. {100 * inside:.0f} % lie inside "
               f"the 95 % band, {100 * above:.0f} % above it, {100 * below:.0f} % below. A "
               "consistent filter has 95 % inside; many below the band mean that it is "
               "conservative.")
    if sensor_figures.noise_factors(run)[1]:
        caption += " Lower panel: factors on the noise parameters of the rig."
    return Section("Consistency", [template.plot(
        lambda: sensor_figures.nis(run), "NIS over time", caption)])


def calibration_section(run, _):
    if run.calibration is None:
        return None
    plots = []
    if sensor_figures.estimated_states(run):
        plots.append(template.plot(
            lambda: sensor_figures.calibration(run), "calibration over time",
            "Sensor calibration estimated by the filter, with one sigma."))
    plots.append(template.plot(
        lambda: sensor_figures.biases(run), "biases over time",
        "Biases of the inertial sensors, with one sigma. The band of the first seconds may exceed "
        "the axes."))
    held = sensor_figures.fixed_states(run)
    return Section("Calibration", plots, f"Not estimated: {'; '.join(held)}." if held else "")


def timeline_section(run, _):
    if run.pings is None and not run.streams:
        return None
    caption = ("Data of each sensor (a break is a gap of five or more sample intervals), and the "
               "verdict on every DVL ping.")
    return Section("Sensors", [template.plot(
        lambda: sensor_figures.timeline(run), "timeline of sensors", caption)])


def map_section(run, _):
    views, count = map_figures.views(run)
    if not views:
        return None
    note = ("Held-out views, not used for training. Drag the line to compare the camera image "
            "(left) with the rendered map (right).")
    if len(views) < count:
        note += f" {len(views)} of {count} views."
    plots = []
    if map_figures.view_panels(run):
        plots.append(template.plot(
            lambda: map_figures.views_over_time(run), "held-out views over time",
            "Metrics of every held-out view. The median image is a baseline that knows only the "
            "color of the water."))
    return Section("Map", plots, note=note, views=views)


def water_section(run, _):
    plots = []
    if run.medium:
        known = " Black lines: ground truth." if run.true_medium else ""
        plots.append(template.plot(
            lambda: map_figures.water(run), "coefficients of the water",
            f"Estimated coefficients of the water.{known}"))
    if map_figures.progress_panels(run) and len(run.mapping) > 1:
        plots.append(template.plot(lambda: map_figures.progress(run), "progress of the map",
                                         "Progress during the optimization of the map."))
    return Section("Water", plots) if plots else None


# In page order; each returns None when the run has no data for it.
SECTIONS = (trajectory_section, map_section, error_section, vision_section, water_section,
            nis_section, calibration_section, timeline_section, timing_section)


def make_sections(run):
    style.apply()
    comparison = compare(run)
    if len(run.estimate) < 2:
        return [trajectory_section(run, None)]
    made = [make(run, comparison) for make in SECTIONS]
    return [section for section in made if section is not None]


def scale_note(scale):
    """What to know about the scale of a run (section `scale` of metrics.json); empty if nothing."""
    if not scale.get("known", True):
        unit = "the first scene" if scale.get("source") == "images" else "the given poses"
        return f"scale unknown: distances are in units of {unit}, not meters"
    if scale.get("source") == "accelerometer":
        return "scale from the accelerometer alone: distances are uncertain"
    return ""


def subtitle(run):
    parts = []
    if run.start_s > EPOCH_PLAUSIBLE_S:
        recorded = datetime.datetime.fromtimestamp(run.start_s, datetime.timezone.utc)
        parts.append(f"recorded {recorded:%Y-%m-%d %H:%M} UTC")
    parts.append(f"run of {run.date:%Y-%m-%d %H:%M}")
    build = run.metrics.get("build", {})
    if "git" in build:
        parts.append(f"revision {build['git']}")
    if "backend" in build:
        parts.append(f"backend {build['backend']}")
    note = scale_note(run.metrics.get("scale", {}))
    return parts + [note] if note else parts


def render(run):
    """Returns the HTML page."""
    estimators, trajectory = metrics_table.trajectory_table(run)
    return template.render(
        "page.html.j2",
        name=run.name, subtitle=subtitle(run), headline=metrics_table.headline(run),
        sections=make_sections(run), estimators=estimators, trajectory=trajectory,
        counts=metrics_table.count_rows(run), dropped=metrics_table.dropped_rows(run),
        others=metrics_table.other_rows(run), warnings=metrics_table.warnings(run), config=run.config, log=run.log)
