# SPDX-License-Identifier: BSD-3-Clause
"""Report page of a sweep: a figure and a table per metric, then the failures."""
import dataclasses
import datetime
import pathlib

import numpy as np
from matplotlib import pyplot

from . import style, template
from .metrics_table import OTHERS, TRAJECTORY
from .sweep_data import better

COLORS = (style.BLUE, style.ORANGE, style.TEAL, style.PURPLE, style.RED, "#5b6b7a", "#b58900",
          "#3aa0c9")


@dataclasses.dataclass
class Section:
    title: str
    plots: list
    note: str = ""
    views: list = dataclasses.field(default_factory=list)
    rows: list = dataclasses.field(default_factory=list)
    table: dict = None


def title_of(column):
    """Title of a metric such as "trajectory.dipo.ate_rmse_m", with its unit."""
    parts = column.split(".")
    if parts[0] == "trajectory" and parts[-1] in TRAJECTORY:
        name, unit, _ = TRAJECTORY[parts[-1]]
        if name.startswith("… "):
            name = f"Absolute position error, {name[2:]}"
        name += f" of {parts[1].upper()}" if len(parts) == 3 else ""
        unit = "" if parts[-1] == "coverage" else unit
    else:
        name, unit, _ = OTHERS.get(column, (column, "", None))
    return f"{name} [{unit}]" if unit else name


def unit_of(column):
    _, bracket, unit = title_of(column).partition("[")
    return unit.rstrip("]") if bracket else ""


def short_names(values):
    """Last path components, if they are unique."""
    names = [pathlib.PurePath(value).name or value for value in values]
    return names if len(set(names)) == len(values) else list(values)


def split_axes(sweep):
    """(rows, columns): lists of (label, choices with None for any). With several axes, the last one
    forms the columns if it has at most eight values."""
    count = len(sweep.axes)
    if count < 2 or len(sweep.alternatives(count - 1)) > 8:
        groups = list(dict.fromkeys(case.choices for case in sweep.cases))
        return [(" · ".join(short_names(choices)), choices) for choices in groups], [("", None)]
    groups = list(dict.fromkeys(case.choices[:-1] for case in sweep.cases))
    across = sweep.alternatives(count - 1)
    return ([(" · ".join(short_names(choices)), choices) for choices in groups],
            list(zip(short_names(across), across)))


def cell_choices(row, column, sweep):
    return row if len(row) == len(sweep.axes) else (*row, column)


def use_log(values):
    return len(values) > 1 and min(values) > 0.0 and max(values) > 30.0 * min(values)


def column_figure(sweep, column):
    """Seeds as dots, means as bars, standard deviations as whiskers; a cross where none finished."""
    rows, across = split_axes(sweep)
    values = [value for case in sweep.cases if case.state == "done"
              for name, value in case.metrics.items() if name == column]
    single = len(across) == 1
    slots = rows if single else across
    height = 3.2 if not style.is_narrow() else 3.6
    figure, axes = pyplot.subplots(figsize=(style.WIDTH, height))
    missing = []
    for i, (label, choices) in enumerate(rows):
        color = COLORS[i % len(COLORS)]
        for j, (_, alternative) in enumerate(across):
            statistic = sweep.statistic(cell_choices(choices, alternative, sweep), column)
            width = 0.8 / (1 if single else len(rows))
            x = i if single else j - 0.4 + (i + 0.5) * width
            draw_group(axes, x, width, statistic, color,
                       None if single or j > 0 else label)
            if not statistic.values:
                missing.append(x)
    axes.set_xticks(range(len(slots)), [label for label, _ in slots],
                    rotation=0 if len(slots) <= (6 if not style.is_narrow() else 2) else 30,
                    ha="center" if len(slots) <= (6 if not style.is_narrow() else 2) else "right")
    axes.set_xlim(-0.6, len(slots) - 0.4)
    axes.grid(visible=False, axis="x")
    if use_log(values):
        axes.set_yscale("log")
    elif values and min(values) >= 0.0:
        axes.set_ylim(bottom=0.0)
    for x in missing:
        axes.annotate("×", (x, 0.02), xycoords=("data", "axes fraction"), ha="center",
                      color=style.RED, fontsize=13)
    axes.set_ylabel(unit_of(column))
    if not single:
        style.legend_above(axes)
    return figure


def draw_group(axes, x, width, statistic, color, label):
    if not statistic.values:
        axes.plot([], [], color=color, marker="o", markersize=5, linestyle="none", label=label)
        return
    axes.bar([x], [statistic.mean], width=0.86 * width, color=color, alpha=0.3, linewidth=0)
    axes.plot([x - 0.43 * width, x + 0.43 * width], [statistic.mean] * 2, color=color, linewidth=2)
    if statistic.spread is not None:
        axes.errorbar([x], [statistic.mean], yerr=[statistic.spread], color=color, capsize=3)
    inside = np.linspace(-0.16, 0.16, len(statistic.values)) if len(statistic.values) > 1 else [0.0]
    axes.plot([x + width * part for part in inside], statistic.values, color=color, marker="o",
              markersize=5, markeredgecolor="white", markeredgewidth=0.8, linestyle="none",
              label=label)


def column_table(sweep, column):
    """Headings and rows of cells (text, whether best in its column, finished/total)."""
    rows, across = split_axes(sweep)
    statistics = [[sweep.statistic(cell_choices(choices, alternative, sweep), column)
                   for _, alternative in across] for _, choices in rows]
    best = better(column)
    marks = []
    for j in range(len(across)):
        means = [line[j].mean for line in statistics if line[j].mean is not None]
        marks.append(best(means) if best and len(set(means)) > 1 else None)
    lines = []
    for (label, _), line in zip(rows, statistics):
        cells = [(s.text(), s.mean is not None and s.mean == mark,
                  f"{s.finished}/{s.total}" if s.total != s.finished or s.total > 1 else "")
                 for s, mark in zip(line, marks)]
        lines.append((label, cells))
    return {"headings": [label for label, _ in across], "rows": lines,
            "axis": " · ".join(sweep.axes[:-1] if len(across) > 1 else sweep.axes)}


def sections(sweep):
    style.apply()
    made = []
    for column in sweep.columns:
        if not any(column in case.metrics for case in sweep.cases):
            continue
        figure = template.plot(lambda column=column: column_figure(sweep, column),
                                  f"{title_of(column)} of every case")
        made.append(Section(title_of(column), [figure], table=column_table(sweep, column)))
    return made


def headline(sweep):
    tiles = [(str(len(sweep.cases)), "", "cases"), (str(sweep.count("done")), "", "finished"),
             (str(sweep.count("failed")), "", "failed")]
    if sweep.count("open"):
        tiles.append((str(sweep.count("open")), "", "not started or interrupted"))
    seeds = {case.seed for case in sweep.cases if case.seed}
    return tiles + ([(str(len(seeds)), "", "seeds")] if seeds else [])


def render(sweep):
    """Returns the HTML page."""
    date = datetime.datetime.fromtimestamp((sweep.folder / "summary.csv").stat().st_mtime)
    failures = [(case.group, case.seed, case.reason) for case in sweep.cases
                if case.state == "failed"]
    return template.render("sweep.html.j2", name=sweep.name,
                           subtitle=[f"sweep of {date:%Y-%m-%d %H:%M}"], headline=headline(sweep),
                           sections=sections(sweep), failures=failures)
