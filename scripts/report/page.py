# SPDX-License-Identifier: BSD-3-Clause
"""Puts the sections of a report together."""
import base64
import dataclasses
import datetime
import pathlib

import jinja2
import numpy as np

from . import figures, metrics_table, sensor_figures, style
from .alignment import compare

MAX_RENDERS = 12
EPOCH_PLAUSIBLE_S = 1e9  # stamps below count from somewhere else


@dataclasses.dataclass
class Picture:
    """A figure of a section: data URI, width on a wide screen [px], caption, alternative text."""
    data: str
    width: int
    caption: str
    alt: str


@dataclasses.dataclass
class Section:
    title: str
    pictures: list = dataclasses.field(default_factory=list)
    note: str = ""


def picture(figure, alt, caption=""):
    width = style.display_width(figure)
    return Picture(style.image_data(figure), width, caption, alt)


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
        depth = "Depth over time; the reference is moved onto the estimate."
    return Section("Trajectory", [
        picture(figures.plan(run, comparison), "the path from above", caption),
        picture(figures.profile(run, comparison), "depth over time", depth)], run.reference_note)


def error_section(run, comparison):
    if comparison is None:
        return None
    caption = (f"Distance from the reference at {len(comparison.t)} common stamps, RMSE "
               f"{comparison.rmse:.3g} m, the trajectories {comparison.words}. Shaded: what the "
               "filter expects of itself, all axes together, counted from its start; an alignment spreads "
               "the error over the run, so the two need not match at the beginning.")
    _, sigma, _ = figures.expected_error(run, comparison.axes)
    if len(sigma) > 0:
        caption += f" The filter's sigma at the end is {sigma[-1]:.2g} m."
    return Section("Error over time",
                   [picture(figures.error(run, comparison), "error over time", caption)])


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
    return Section("Consistency", [picture(sensor_figures.nis(run), "NIS over time", caption)])


def calibration_section(run, _):
    if run.calibration is None:
        return None
    pictures = []
    if sensor_figures.estimated_states(run):
        pictures.append(picture(sensor_figures.calibration(run), "calibration over time",
                                "What the filter learnt about its sensors, with one sigma."))
    pictures.append(picture(sensor_figures.biases(run), "biases over time",
                            "Biases of the inertial sensors, with one sigma. The band of the first "
                            "seconds may reach beyond the axes."))
    held = sensor_figures.held_states(run)
    return Section("Calibration", pictures, f"Held as given: {'; '.join(held)}." if held else "")


def timeline_section(run, _):
    if run.pings is None and not run.streams:
        return None
    caption = ("When each sensor spoke (a break is a gap of five sample times or more), and what "
               "became of every DVL ping.")
    return Section("Sensors",
                   [picture(sensor_figures.timeline(run), "timeline of sensors", caption)])


def renders_section(run, _):
    if not run.renders:
        return None
    chosen = np.unique(np.linspace(0, len(run.renders) - 1, MAX_RENDERS).round().astype(int))
    pictures = [Picture("data:image/png;base64," + base64.b64encode(path.read_bytes()).decode(),
                        490, path.stem.replace("_", " "), path.stem)
                for path in (run.renders[i] for i in chosen)]
    note = "" if len(chosen) == len(run.renders) else f"{len(chosen)} of {len(run.renders)} images."
    return Section("Renders", pictures, note)


# In the order of the page; each gives None when the run has nothing to show in it.
SECTIONS = (trajectory_section, error_section, nis_section, calibration_section, timeline_section,
            renders_section)


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
    folder = pathlib.Path(__file__).resolve().parent
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(folder), autoescape=True,
                                     trim_blocks=True, lstrip_blocks=True,
                                     undefined=jinja2.StrictUndefined)
    estimators, trajectory = metrics_table.trajectory_table(run)
    return environment.get_template("page.html.j2").render(
        name=run.name, subtitle=subtitle(run), headline=metrics_table.headline(run),
        sections=make_sections(run), estimators=estimators, trajectory=trajectory,
        counts=metrics_table.count_rows(run), dropped=metrics_table.dropped_rows(run),
        others=metrics_table.other_rows(run), config=run.config, log=run.log)


def write(run, output):
    """Writes the page in one step, so that a reader never sees half of it."""
    partial = output.with_name(output.name + ".partial")
    partial.write_text(render(run), encoding="utf-8")
    partial.replace(output)
