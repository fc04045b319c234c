# SPDX-License-Identifier: BSD-3-Clause
"""Figures of visual tracking, fusion states and computing time."""
import numpy as np
from matplotlib import pyplot, ticker

from . import style
from .figures import clock_of, pose_intervals, verdict_bands
from .run_data import seconds

EIGENVALUES = {"rotation_eigenvalue_": ("rotation [1/rad²]", "rotation"),
               "position_eigenvalue_": ("position [1/m²]", "position")}
STAGES = {  # label: (color, columns of timing.csv that are summed)
    "image decoding": (style.REFERENCE, ("decode",)),
    "front end": (style.BLUE, ("track",)),
    "back end": (style.ORANGE, ("solve", "information", "marginalize")),
    "front end to fusion": (style.TEAL, ("track", "localize")),
}


def positive(values):
    """Replaces non-positive values by NaN, for logarithmic axes."""
    return np.where(values > 0.0, values, np.nan)


def has_features(run):
    return run.health is not None and all(
        name in run.health for name in ("tracked", "detected", "stable", "landmarks"))


def has_eigenvalues(run):
    return has_features(run) and all(
        f"{prefix}1" in run.health and np.any(run.health[f"{prefix}1"] > 0.0)
        for prefix in EIGENVALUES)


def feature_panel(axes, t, health):
    axes.plot(t, health["tracked"] + health["detected"], color=style.REFERENCE, linewidth=1.2,
              label="corners")
    axes.plot(t, health["stable"], color=style.BLUE, linewidth=1.4, label="stable tracks")
    axes.plot(t, health["landmarks"], color=style.ORANGE, linewidth=1.2, label="landmarks")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("count")


def eigenvalue_panel(run, axes, t, prefix):
    label, key = EIGENVALUES[prefix]
    for i, shade in enumerate((1.0, 0.6, 0.35), start=1):
        axes.plot(t, positive(run.health[f"{prefix}{i}"]), color=style.PURPLE, alpha=shade,
                  linewidth=1.2, label=("smallest", "middle", "largest")[i - 1])
    # Older runs have the old key.
    threshold = (run.setting("fusion", "discriminator", "degeneracy", f"min_{key}_eigenvalue")
                 or run.setting("fusion", "discriminator", "fine", f"min_{key}"))
    if threshold and float(threshold) > 0.0:
        axes.axhline(float(threshold), color=style.RED, linewidth=1.2, linestyle=(0, (4, 3)),
                     label="threshold")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(ticker.LogLocator(numticks=5))
    axes.set_ylabel(label)


def features(run):
    """Corners, landmarks, and eigenvalues of the newest pose's information matrix over time."""
    count = 3 if has_eigenvalues(run) else 1
    figure, all_axes = pyplot.subplots(count, figsize=(style.WIDTH, 0.6 + 2.2 * count), sharex=True,
                                       squeeze=False)
    clock = clock_of(run)
    t = clock(seconds(run.health, run.start_s))
    panels = list(all_axes[:, 0])
    for axes in panels:
        verdict_bands(run, axes, clock, label=False)
    feature_panel(panels[0], t, run.health)
    for axes, prefix in zip(panels[1:], EIGENVALUES):
        eigenvalue_panel(run, axes, t, prefix)
    for axes in panels[:2]:
        style.legend_above(axes)
    clock.label(panels[-1])
    figure.align_ylabels()
    return figure


def verdicts(run):
    """A strip with the pose source of each frame."""
    clock = clock_of(run)
    figure, axes = pyplot.subplots(figsize=(style.WIDTH, 1.15 if not style.is_narrow() else 1.5))
    named = set()
    for state, start, end in pose_intervals(run):
        if end <= 0.0:
            continue
        label, color = style.pose_style(state)
        axes.axvspan(clock(max(start, 0.0)), clock(end), color=color, linewidth=0,
                     label=None if state in named else label)
        named.add(state)
    axes.set_yticks([])
    axes.grid(visible=False)
    axes.spines["left"].set_visible(False)
    clock.label(axes)
    style.legend_above(axes)
    return figure


def reason_rows(run):
    """(reason, number of frames) of the frames with rejected vision, most frequent first."""
    health = run.health
    if health is None or "reason" not in health:
        return []
    names, counts = np.unique(health["reason"].astype(str), return_counts=True)
    rows = [(str(name).replace("_", " "), int(n)) for name, n in zip(names, counts)
            if name != "none"]
    return sorted(rows, key=lambda row: -row[1])


def stage_times(run):
    """Name -> milliseconds per frame, of the stages with recorded times."""
    found = {}
    for name, (_, columns) in STAGES.items():
        if run.timing is None or any(column not in run.timing for column in columns):
            continue
        total = 1e3 * sum(run.timing[column] for column in columns)
        if np.any(total > 0.0):
            found[name] = total[total > 0.0]
    return found


def timing(run):
    """A histogram per stage, with median and 99th percentile."""
    found = stage_times(run)
    figure, all_axes = pyplot.subplots(len(found), figsize=(style.WIDTH, 0.5 + 1.25 * len(found)),
                                       sharex=True, squeeze=False)
    # Slow outliers would compress the rest: they are counted in the last bin.
    end = 1.25 * max(np.quantile(values, 0.99) for values in found.values())
    bins = np.linspace(0.0, end, 61 if not style.is_narrow() else 41)
    for axes, (name, values) in zip(all_axes[:, 0], found.items()):
        color = STAGES[name][0]
        axes.hist(np.minimum(values, end), bins=bins, color=color, alpha=0.75, linewidth=0)
        median, slow = np.quantile(values, (0.5, 0.99))
        for value, dashes in ((median, (0, ())), (slow, (0, (3, 2)))):
            axes.axvline(value, color=style.INK, linewidth=1.0, linestyle=dashes)
        axes.set_title(f"{name}: median {median:.1f} ms, 99 % within {slow:.1f} ms",
                       fontweight="normal")
        axes.set_yticks([])
        axes.grid(visible=False, axis="y")
        axes.spines["left"].set_visible(False)
    all_axes[-1, 0].set_xlabel("time per frame [ms]")
    all_axes[-1, 0].set_xlim(0.0, end)
    return figure
