# SPDX-License-Identifier: BSD-3-Clause
"""Figures of the sensors, their calibration and the filter consistency."""
import math

import numpy as np
from matplotlib import pyplot, ticker

from . import style
from .figures import clock_of, scatter
from .run_data import seconds

# Column of calibration.csv: (title, components, factor to the unit shown, unit).
CALIBRATION = {
    "dvl_time_offset": ("DVL time offset", (), 1e3, "ms"),
    "dvl_scale_error": ("DVL scale error", (), 1e2, "%"),
    "mounting": ("DVL mounting", ("x", "y", "z"), 180.0 / math.pi, "°"),
    "lever": ("DVL lever arm", ("x", "y", "z"), 1e2, "cm"),
    "depth_bias": ("Depth bias", (), 1e2, "cm"),
}
SETTLED = 0.1  # bands of the first tenth of a run, before convergence, do not scale the axes


def columns(state, components):
    return [f"{state}_{c}" for c in components] or [state]


def is_estimated(table, state):
    return bool(np.any(table[f"{state}_sigma"] > 0.0))


def limits(values, sigma):
    """Axis limits that include all values, and the band after convergence."""
    late = slice(int(SETTLED * values.shape[1]), None)
    low = min(values.min(), (values - sigma)[:, late].min())
    high = max(values.max(), (values + sigma)[:, late].max())
    margin = 0.06 * max(high - low, 1e-12)
    return low - margin, high + margin


def band_panel(axes, t, table, state, components, factor):
    """Values with a one-sigma band."""
    values = factor * np.array([table[name] for name in columns(state, components)])
    sigma = factor * table[f"{state}_sigma"]
    colors = style.AXES if components else (style.BLUE,)
    for value, color, name in zip(values, colors, components or (None,)):
        axes.fill_between(t, value - sigma, value + sigma, color=color, alpha=0.14, linewidth=0)
        axes.plot(t, value, color=color, label=name)
    axes.set_ylim(*limits(values, sigma))
    if components:
        style.legend_above(axes, handletextpad=0.5)


def estimated_states(run):
    return [state for state in CALIBRATION if f"{state}_sigma" in run.calibration
            and is_estimated(run.calibration, state)]


def fixed_states(run):
    """Descriptions of states that were not estimated: "DVL scale error 0 %"."""
    held = []
    for state, (title, components, factor, unit) in CALIBRATION.items():
        if f"{state}_sigma" not in run.calibration or is_estimated(run.calibration, state):
            continue
        values = [factor * run.calibration[name][-1] for name in columns(state, components)]
        shown = ", ".join(f"{round(value, 2) + 0.0:g}" for value in values)
        held.append(f"{title} {f'({shown})' if components else shown} {unit}")
    return held


def panel_grid(count):
    """Figure and flat list of axes, in up to two columns."""
    across = 1 if style.is_narrow() else min(count, 2)
    down = math.ceil(count / across)
    figure, axes = pyplot.subplots(down, across, figsize=(style.WIDTH, 0.4 + 2.5 * down),
                                   sharex=True, squeeze=False)
    axes = list(axes.flat)
    for spare in axes[count:]:
        spare.remove()
    for above in axes[max(0, count - across):count]:
        above.tick_params(labelbottom=True)
    return figure, axes[:count], across


def band_figure(run, panels):
    """`panels`: list of (title, state, components, factor, unit)."""
    figure, all_axes, across = panel_grid(len(panels))
    clock = clock_of(run)
    t = clock(seconds(run.calibration, run.start_s))
    for axes, (title, state, components, factor, unit) in zip(all_axes, panels):
        band_panel(axes, t, run.calibration, state, components, factor)
        axes.set_title(title)
        axes.set_ylabel(f"[{unit}]")
        axes.set_xlim(0.0, 1.005 * clock.end)
    for axes in all_axes[-across:]:
        clock.label(axes)
    return figure


def calibration(run):
    return band_figure(run, [(CALIBRATION[state][0], state, *CALIBRATION[state][1:])
                             for state in estimated_states(run)])


def biases(run):
    table, xyz = run.calibration, ("x", "y", "z")
    gyro = np.array([table[name] for name in columns("gyro_bias", xyz)])
    per_hour = np.abs(gyro).max() < 5e-4  # unit for high-grade gyroscopes
    gyro_unit = (math.degrees(3600.0), "°/h") if per_hour else (math.degrees(1.0), "°/s")
    return band_figure(run, [("Gyroscope bias", "gyro_bias", xyz, *gyro_unit),
                             ("Accelerometer bias", "accel_bias", xyz, 1e3, "mm/s²")])


def lower_gamma(a, x):
    """Regularized lower incomplete gamma function by its series (DLMF 8.11.4)."""
    if x <= 0.0:
        return 0.0
    term = total = 1.0 / a
    n = 0
    while term > 1e-15 * total:
        n += 1
        term *= x / (a + n)
        total += term
    return total * math.exp(a * math.log(x) - x - math.lgamma(a))


def chi_square_quantile(probability, degrees):
    """Quantile by bisection, accurate to nine digits."""
    low, high = 0.0, 10.0 * degrees + 50.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        below = lower_gamma(0.5 * degrees, 0.5 * middle) < probability
        low, high = (middle, high) if below else (low, middle)
    return 0.5 * (low + high)


def nis_bounds(degrees):
    """The band [2, n] that contains 95 % of the NIS of a consistent filter."""
    table = {d: [chi_square_quantile(q, d) for q in (0.025, 0.975)] for d in set(degrees)}
    return np.array([table[d] for d in degrees]).T


def pings_with_nis(run):
    """(time [s], NIS, degrees of freedom, verdict) of the pings with a NIS."""
    pings = run.pings
    degrees = pings["degrees_of_freedom"].astype(int)
    used = (degrees > 0) & (pings["nis"] > 0.0)
    return (seconds(pings, run.start_s)[used], pings["nis"][used], degrees[used],
            pings["verdict"][used])


def band_fractions(run):
    """Fractions of the pings with their NIS inside, above and below the band."""
    _, nis, degrees, _ = pings_with_nis(run)
    low, high = nis_bounds(degrees)
    return np.mean((nis >= low) & (nis <= high)), np.mean(nis > high), np.mean(nis < low)


def noise_factors(run):
    """Times [s] and adaptive noise factors of the pings used for adaptation."""
    names = {"accel_noise_factor": "accelerometer noise", "dvl_variance_factor": "DVL variance",
             "dvl_noise_scale": "DVL variance"}
    used = run.pings["degrees_of_freedom"] > 0
    return seconds(run.pings, run.start_s)[used], {
        label: run.pings[name][used] for name, label in names.items() if name in run.pings}


def nis(run):
    """NIS of every ping by verdict over its 95 % band; below, the noise factors."""
    factor_t, factors = noise_factors(run)
    figure, all_axes = pyplot.subplots(
        1 + bool(factors), figsize=(style.WIDTH, 5.0 if factors else 3.2), sharex=True,
        squeeze=False, gridspec_kw={"height_ratios": [2.0, 1.0] if factors else [1.0]})
    clock = clock_of(run)
    axes = all_axes[0, 0]
    t, values, degrees, verdicts = pings_with_nis(run)
    low, high = nis_bounds(degrees)
    axes.fill_between(clock(t), low, high, step="mid", color=style.REFERENCE, alpha=0.3,
                      linewidth=0, label="95 % band")
    for name in [*style.VERDICTS, *sorted(set(verdicts) - set(style.VERDICTS))]:
        some = verdicts == name
        if some.any():
            label, color = style.verdict_style(name)
            scatter(axes, clock(t[some]), values[some], marker=".", markersize=5, color=color,
                    markeredgewidth=0, alpha=0.75, label=label)
    axes.set_yscale("log")
    axes.set_ylim(max(1e-3, 0.7 * min(values.min(), low.min())),
                  2.0 * max(values.max(), high.max()))
    axes.set_ylabel("NIS")
    style.legend_above(axes, markerscale=2.0)
    if factors:
        factor_panel(all_axes[1, 0], clock(factor_t), factors)
    clock.label(all_axes[-1, 0])
    figure.align_ylabels()
    return figure


def factor_panel(axes, t, factors):
    for (name, values), color in zip(factors.items(), (style.PURPLE, style.TEAL)):
        axes.plot(t, values, color=color, label=name)
    axes.set_yscale("log")
    for side in (axes.yaxis.set_major_formatter, axes.yaxis.set_minor_formatter):
        side(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(ticker.LogLocator(subs=(2, 5), numticks=6))
    axes.set_ylabel("noise factor")
    style.legend_above(axes)


def spans(stamps):
    """Intervals (start, length) without gaps of five or more sample intervals."""
    gaps = np.flatnonzero(np.diff(stamps) > 5.0 * np.median(np.diff(stamps)))
    starts = stamps[np.concatenate([[0], gaps + 1])]
    ends = stamps[np.concatenate([gaps, [len(stamps) - 1]])]
    return list(zip(starts, ends - starts))


STREAMS = {"imu": "IMU", "dvl": "DVL with lock", "depth": "depth", "pressure": "pressure",
           "cam": "camera", "gnss": "GNSS", "state_groundtruth_estimate": "reference"}


def kind_of(stream):
    return stream.rstrip("0123456789")


def ordered_streams(run):
    """(label, stamps) in the order of STREAMS."""
    order = list(STREAMS)
    kinds = {name: kind_of(name) for name in run.streams}
    several = {kind for kind in STREAMS if list(kinds.values()).count(kind) > 1}

    def stream_label(name):
        number = f" {name[-1]}" if kinds[name] in several else ""
        return STREAMS.get(kinds[name], name) + number

    names = sorted(kinds, key=lambda name: (*order, kinds[name]).index(kinds[name]))
    return [(stream_label(name), run.streams[name]) for name in names]


def timeline(run):
    """Availability of each sensor, and the verdict on every ping."""
    clock = clock_of(run)
    verdicts = run.pings["verdict"] if run.pings is not None else np.empty(0, dtype=str)
    names = [name for name in style.VERDICTS if (verdicts == name).any()]
    streams = ordered_streams(run)
    rows = [name for name, _ in streams]
    rows += [f"ping {style.verdict_style(name)[0]}" for name in names]
    figure, axes = pyplot.subplots(figsize=(style.WIDTH, 0.8 + 0.34 * len(rows)))
    for row, (_, stamps) in enumerate(streams):
        axes.broken_barh([(clock(a), clock(b)) for a, b in spans(stamps)], (row - 0.28, 0.56),
                         color=style.BLUE, alpha=0.75, linewidth=0)
    for row, name in enumerate(names, start=len(streams)):
        t = clock(seconds(run.pings, run.start_s)[verdicts == name])
        axes.vlines(t, row - 0.28, row + 0.28, color=style.verdict_style(name)[1],
                    linewidth=np.clip(600.0 / len(t), 0.7, 2.5), rasterized=len(t) > 1000)
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(len(rows) - 0.45, -0.55)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.spines["left"].set_visible(False)
    clock.label(axes)
    return figure
