# SPDX-License-Identifier: BSD-3-Clause
"""Figures of the trajectory and its errors. Each function returns a matplotlib figure."""
import numpy as np
from matplotlib import pyplot

from . import style
from .run_data import seconds

MAX_VECTOR_POINTS = 5000  # more points are rasterized, to limit the page size


class Clock:
    """The time axis of a run, in seconds or, for long runs, minutes."""

    def __init__(self, duration_s):
        self.scale, self.unit = (1.0, "s") if duration_s <= 600.0 else (60.0, "min")
        self.end = duration_s / self.scale
        self.length = duration_s

    def __call__(self, t):
        return np.asarray(t) / self.scale

    def label(self, axes):
        axes.set_xlabel(f"time [{self.unit}]")
        axes.set_xlim(0.0, 1.005 * self.end)


def clock_of(run):
    return Clock(max(run.estimate.t[-1], 1e-3))


def scatter(axes, x, y, **kwargs):
    axes.plot(x, y, linestyle="none", rasterized=len(x) > MAX_VECTOR_POINTS, **kwargs)


def aligned_tracks(run, comparison):
    """The estimate and the other trajectories, aligned to the reference if there is one."""
    def move(track):
        return comparison.motion.apply(track) if comparison else track
    others = {name: move(track) for name, track in run.others.items()
              if len(track) > 1 and not same_path(track, run.estimate)}
    return move(run.estimate), others


def same_path(a, b):
    return len(a) == len(b) and np.allclose(a.p, b.p, atol=1e-6)


def reference_in_span(run):
    return run.reference.within(run.estimate.t[0] - 1.0, run.estimate.t[-1] + 1.0)


def plan_size(extent):
    """Figure size [in] of a top view: as wide as the page unless the path is tall."""
    aspect = np.clip(extent[0] / max(extent[1], 1e-9), 0.9, 2.4)
    height = min(style.WIDTH / aspect, 6.6)
    return min(style.WIDTH, aspect * height + 0.8), height


def emptiest_corner(axes, points):
    """Center, in axes coordinates, of the corner with the fewest points."""
    corners = np.array([[0.87, 0.06], [0.13, 0.06], [0.87, 0.91], [0.13, 0.91]])
    parts = axes.transAxes.inverted().transform(axes.transData.transform(points))
    near = [(np.abs(parts - corner) < (0.14, 0.09)).all(axis=1).sum() for corner in corners]
    return corners[int(np.argmin(near))]


def scale_bar(axes, points):
    """A scale bar of a round length, in the emptiest corner."""
    limits = axes.axis()
    wanted = (limits[1] - limits[0]) / 6.0
    power = 10.0**np.floor(np.log10(wanted))
    length = max(step * power for step in (1, 2, 5) if step * power <= wanted)
    center = axes.transAxes.transform(emptiest_corner(axes, points))
    x, y = axes.transData.inverted().transform(center)
    axes.plot([x - length / 2.0, x + length / 2.0], [y, y], color=style.INK, linewidth=3,
              solid_capstyle="butt")
    axes.annotate(f"{length:g} m", (x, y), xytext=(0, 5), textcoords="offset points", ha="center")
    axes.axis(limits)


def mark_ends(axes, p):
    ends = ((p[0], "o", style.TEAL, "start"), (p[-1], "s", style.RED, "end"))
    for point, marker, color, name in ends:
        axes.plot(*point[:2], marker=marker, color=color, markersize=9, markeredgecolor="white",
                  markeredgewidth=1.5, linestyle="none", label=name, zorder=5)


def plan(run, comparison):
    """Top view of the path."""
    estimate, others = aligned_tracks(run, comparison)
    parts = [estimate.p]
    figure, axes = pyplot.subplots()
    if comparison:
        reference = reference_in_span(run)
        parts.append(reference.p)
        axes.plot(*reference.p.T[:2], color=style.REFERENCE, linewidth=4.0, label="reference")
    for name, track in others.items():
        axes.plot(*track.p.T[:2], color=style.TRACKS[name], linewidth=1.2, label=name)
    axes.plot(*estimate.p.T[:2], color=style.BLUE, linewidth=1.6, label="estimate")
    mark_ends(axes, estimate.p)
    everything = np.vstack(parts)[:, :2]
    figure.set_size_inches(plan_size(np.ptp(everything, axis=0)))
    names = ("east", "north") if run.axes_known else ("x", "y")
    axes.set_xlabel(f"{names[0]} [m]")
    axes.set_ylabel(f"{names[1]} [m]")
    axes.set_aspect("equal", adjustable="datalim")
    style.legend_above(axes)
    figure.canvas.draw()  # computes the axis limits
    scale_bar(axes, everything)
    return figure


def height_offset(track, onto):
    """Median height of `onto` above `track` over their common time span [m]."""
    if len(track) < 2 or len(onto) < 2:
        return 0.0
    t = track.t[(track.t >= onto.t[0]) & (track.t <= onto.t[-1])]
    if len(t) == 0:
        return 0.0
    return float(np.median(np.interp(t, onto.t, onto.p[:, 2]) - np.interp(t, track.t, track.p[:, 2])))


def profile(run, comparison):
    """Depth over time, shifted to the heights of DIPO, which match the pressure sensor."""
    estimate, others = aligned_tracks(run, None)
    offset = height_offset(estimate, others["DIPO"]) if "DIPO" in others else 0.0
    clock = clock_of(run)
    figure, axes = pyplot.subplots(figsize=(style.WIDTH, 2.7))
    if comparison and not run.reference.planar:
        reference = comparison.motion.inverse().apply(reference_in_span(run))
        axes.plot(clock(reference.t), -offset - reference.p[:, 2], color=style.REFERENCE, linewidth=4.0,
                  label="reference")
    for name, track in others.items():
        own = 0.0 if name == "DIPO" else offset
        axes.plot(clock(track.t), -own - track.p[:, 2], color=style.TRACKS[name], linewidth=1.2,
                  label=name)
    axes.plot(clock(estimate.t), -offset - estimate.p[:, 2], color=style.BLUE, label="estimate")
    axes.set_ylabel("depth [m]")
    axes.invert_yaxis()
    clock.label(axes)
    style.legend_above(axes)
    return figure


def expected_error(run, axes):
    """(time [s], sigma of the position error norm over `axes` axes [m], sigma of rotation [deg])."""
    names = ("position_sigma", "rotation_sigma")
    if run.pings is None or any(name not in run.pings for name in names):
        return np.empty(0), np.empty(0), np.empty(0)
    return (seconds(run.pings, run.start_s), np.sqrt(axes) * run.pings[names[0]],
            np.sqrt(3.0) * run.pings[names[1]])


def pose_intervals(run):
    """(state, start [s], end [s]) of intervals of frames with the same pose source."""
    if run.health is None or "state" not in run.health or len(run.health) < 2:
        return []
    t, states = seconds(run.health, run.start_s), run.health["state"]
    changes = np.flatnonzero(states[1:] != states[:-1]) + 1
    starts = np.concatenate([[0], changes])
    ends = np.concatenate([changes, [len(t) - 1]])
    return [(states[a], t[a], t[b]) for a, b in zip(starts, ends) if t[b] > t[a]]


def verdict_bands(run, axes, clock, label=True):
    """Background bands that show the pose source of the frames: fused, frozen, dropped."""
    named = set()
    for state, start, end in pose_intervals(run):
        if end <= 0.0:
            continue  # before the first pose
        text, color = style.pose_style(state)
        name = text if label and state not in named and end - start > 0.004 * clock.length else None
        named |= {state} if name else set()
        axes.axvspan(clock(max(start, 0.0)), clock(end), color=color, linewidth=0, zorder=0,
                     alpha=0.08 if state == "fused" else 0.22, label=name)


def error_panel(axes, t, error, sigma, label):
    axes.plot(sigma[0], sigma[1], color=style.MUTED, linewidth=1.1, linestyle=(0, (4, 3)),
              label="sigma of DIPO")
    axes.plot(t, error, color=style.BLUE, label="error")
    axes.set_ylabel(label)
    highest = np.max(error)
    expected = np.quantile(sigma[1], 0.9) if len(sigma[1]) else 0.0
    top = 1.08 * (max(highest, expected) if expected < 3.0 * highest else highest)
    axes.set_ylim(0.0, top if top > 0.0 else 1.0)


def error(run, comparison):
    """Position and rotation error over time, with the standard deviations of the filter."""
    clock = clock_of(run)
    sigma_t, position_sigma, rotation_sigma = expected_error(run, comparison.axes)
    panels = 2 if comparison.rotation is not None else 1
    figure, axes = pyplot.subplots(panels, figsize=(style.WIDTH, 0.5 + 2.3 * panels), sharex=True,
                                   squeeze=False)
    kind = "horizontal error" if comparison.axes == 2 else "position error"
    error_panel(axes[0, 0], clock(comparison.t), comparison.position,
                (clock(sigma_t), position_sigma), f"{kind} [m]")
    if panels == 2:
        error_panel(axes[1, 0], clock(comparison.t), comparison.rotation,
                    (clock(sigma_t), rotation_sigma), "rotation error [°]")
    for i, panel in enumerate(axes[:, 0]):
        verdict_bands(run, panel, clock, label=i == 0)
    style.legend_above(axes[0, 0])
    clock.label(axes[-1, 0])
    figure.align_ylabels()
    return figure
