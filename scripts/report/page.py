# SPDX-License-Identifier: BSD-3-Clause
"""Puts the sections of a run's report together."""
import dataclasses
import datetime

from . import figures, map_figures, metrics_table, sensor_figures, style, template, vision_figures
from .alignment import compare

EPOCH_PLAUSIBLE_S = 1e9  # stamps below count from somewhere else


@dataclasses.dataclass
class Section:
    title: str
    pictures: list = dataclasses.field(default_factory=list)
    note: str = ""
    views: list = dataclasses.field(default_factory=list)  # of a map, to slide over
    rows: list = dataclasses.field(default_factory=list)   # (words, number) of a small table


def trajectory_section(run, comparison):
    if len(run.estimate) < 2:
        return Section("Trajectory", note="The run has fewer than two poses.")
    caption = "The path from above."
    if comparison:
        caption += f" Estimate and reference are {comparison.words}."
    depth = "Depth over time."
    if comparison and run.reference.planar:
        depth = "Depth over time, of the estimate alone: the reference has no heights."
    elif comparison:
        depth = "Depth over time; all are moved onto each other."
    return Section("Trajectory", [
        template.picture(lambda: figures.plan(run, comparison), "the path from above", caption),
        template.picture(lambda: figures.profile(run, comparison), "depth over time", depth)],
                   run.reference_note)


def error_section(run, comparison):
    if comparison is None:
        return None
    caption = (f"Distance from the reference at {len(comparison.t)} common stamps, RMSE "
               f"{comparison.rmse:.3g} m, the trajectories {comparison.words}. Dashed: what DIPO "
               "expects of itself, all axes together, counted from its start; an alignment "
               "spreads the error over the run, so the two need not match at the beginning.")
    _, sigma, _ = figures.expected_error(run, comparison.axes)
    if len(sigma) > 0:
        caption += f" DIPO's sigma at the end is {sigma[-1]:.2g} m."
    if figures.pose_spells(run):
        caption += " Colours behind: where each frame's pose came from."
    return Section("Error over time", [template.picture(
        lambda: figures.error(run, comparison), "error over time", caption)])


def vision_section(run, _):
    if not vision_figures.has_features(run):
        return None
    pictures = [
        template.picture(lambda: vision_figures.verdicts(run), "verdicts over time",
                         "Where the pose of each frame came from: fused with vision, from DVL and "
                         "pressure while vision fails (frozen: the window is kept), or dropped."),
        template.picture(lambda: vision_figures.features(run), "features over time",
                         "Corners in the image, those tracked for long, and landmarks in the "
                         "solution" + ("; below, the eigenvalues of what the window knows about "
                                       "its newest pose, with the threshold of the discriminator."
                                       if vision_figures.has_eigenvalues(run) else "."))]
    frames = len(run.health)
    rows = [(words, f"{count} of {frames}") for words, count in vision_figures.reason_rows(run)]
    return Section("Vision", pictures, rows=rows)


def timing_section(run, _):
    if not vision_figures.stage_times(run):
        return None
    return Section("Computing time", [template.picture(
        lambda: vision_figures.timing(run), "histogram of computing times",
        "Of every camera frame; the last bar holds all that took longer.")])


def nis_section(run, _):
    if run.pings is None or "nis" not in run.pings or len(sensor_figures.judged(run)[0]) == 0:
        return None
    inside, above, below = sensor_figures.share_inside(run)
    caption = (f"Normalised innovation squared of every DVL ping. {100 * inside:.0f} % lie inside "
               f"the band, {100 * above:.0f} % above it, {100 * below:.0f} % below; 95 % inside "
               "would mean that the filter knows its own uncertainty exactly, and many below that "
               "it is cautious.")
    if sensor_figures.noise_factors(run)[1]:
        caption += " Lower panel: the factors that the noises of the rig were multiplied by."
    return Section("Consistency", [template.picture(
        lambda: sensor_figures.nis(run), "NIS over time", caption)])


def calibration_section(run, _):
    if run.calibration is None:
        return None
    pictures = []
    if sensor_figures.estimated_states(run):
        pictures.append(template.picture(
            lambda: sensor_figures.calibration(run), "calibration over time",
            "What the filter learnt about its sensors, with one sigma."))
    pictures.append(template.picture(
        lambda: sensor_figures.biases(run), "biases over time",
        "Biases of the inertial sensors, with one sigma. The band of the first seconds may reach "
        "beyond the axes."))
    held = sensor_figures.held_states(run)
    return Section("Calibration", pictures, f"Held as given: {'; '.join(held)}." if held else "")


def timeline_section(run, _):
    if run.pings is None and not run.streams:
        return None
    caption = ("When each sensor spoke (a break is a gap of five sample times or more), and what "
               "became of every DVL ping.")
    return Section("Sensors", [template.picture(
        lambda: sensor_figures.timeline(run), "timeline of sensors", caption)])


def map_section(run, _):
    views, count = map_figures.views(run)
    if not views:
        return None
    note = ("Views that the map never learnt from, drag the line: on the left what the camera saw, "
            "on the right what the map makes of it.")
    if len(views) < count:
        note += f" {len(views)} of {count} views."
    pictures = []
    if map_figures.view_panels(run):
        pictures.append(template.picture(
            lambda: map_figures.views_over_time(run), "held-out views over time",
            "Every view that the map never learnt from. Its median image is what sees nothing but "
            "the water."))
    return Section("Map", pictures, note=note, views=views)


def water_section(run, _):
    pictures = []
    if run.medium:
        known = " Black lines: the truth of the simulation." if run.true_medium else ""
        pictures.append(template.picture(
            lambda: map_figures.water(run), "coefficients of the water",
            f"What the map found out about the water.{known}"))
    if map_figures.progress_panels(run) and len(run.mapping) > 1:
        pictures.append(template.picture(lambda: map_figures.progress(run), "progress of the map",
                                         "While the map was learnt."))
    return Section("Water", pictures) if pictures else None


# In the order of the page; each gives None when the run has nothing to show in it.
SECTIONS = (trajectory_section, map_section, error_section, vision_section, water_section,
            nis_section, calibration_section, timeline_section, timing_section)


def make_sections(run):
    style.apply()
    comparison = compare(run)
    if len(run.estimate) < 2:
        return [trajectory_section(run, None)]
    made = [make(run, comparison) for make in SECTIONS]
    return [section for section in made if section is not None]


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
    return parts


def render(run):
    """The page as text."""
    estimators, trajectory = metrics_table.trajectory_table(run)
    return template.render(
        "page.html.j2",
        name=run.name, subtitle=subtitle(run), headline=metrics_table.headline(run),
        sections=make_sections(run), estimators=estimators, trajectory=trajectory,
        counts=metrics_table.count_rows(run), dropped=metrics_table.dropped_rows(run),
        others=metrics_table.other_rows(run), config=run.config, log=run.log)
