# SPDX-License-Identifier: BSD-3-Clause
"""Style of the figures: one palette, thin lines, units on axes, no decoration."""
import base64
import contextlib
import io

import matplotlib
matplotlib.use("Agg")
from matplotlib import font_manager, pyplot  # noqa: E402  pylint: disable=wrong-import-position

INK, MUTED, GRID = "#1f2933", "#67737f", "#e3e8ec"
BLUE, ORANGE, TEAL, RED, PURPLE = "#1565b0", "#dd7a17", "#12866f", "#c4303b", "#7b53b3"
REFERENCE = "#a3adb8"
AXES = (BLUE, ORANGE, TEAL)  # x, y, z
TRACKS = {"Smoothed": PURPLE, "VIO": ORANGE, "DIPO": TEAL}
VERDICTS = {  # verdict in pings.csv: (label, color)
    "accepted": ("accepted", TEAL),
    "downweighted": ("downweighted", ORANGE),
    "rejected": ("rejected", RED),
    "beams_disagree": ("beams disagree", PURPLE),
    "no_lock": ("no bottom lock", INK),
    "repeated": ("repeated", "#b58900"),
    "too_old": ("too old", REFERENCE),
}
POSES = {  # `state` in health.csv: (label, color), from most to least trusted
    "fused": ("fused", TEAL),
    "vio_only": ("vision alone", "#7fb8a8"),
    "up_to_scale": ("vision alone, up to scale", PURPLE),
    "dipo_only": ("DVL alone", "#e2b366"),
    "frozen": ("frozen", BLUE),
    "dropped": ("dropped", RED),
    "waiting": ("waiting", REFERENCE),
}
FONTS = ("Liberation Sans", "DejaVu Sans")
WIDE, NARROW = 10.0, 5.0  # full figure width on a desktop and on a phone [in]
WIDTH = WIDE              # current figure width
PIXELS_PER_INCH = 104


def verdict_style(name):
    return VERDICTS.get(name, (name.replace("_", " "), MUTED))


def pose_style(name):
    return POSES.get(name, (str(name).replace("_", " "), MUTED))


def is_narrow():
    return WIDTH < 0.8 * WIDE


@contextlib.contextmanager
def narrow():
    """Context in which figures are made for a phone."""
    global WIDTH  # pylint: disable=global-statement
    WIDTH = NARROW
    try:
        yield
    finally:
        WIDTH = WIDE


def apply():
    """Applies the style to all subsequent figures."""
    installed = {font.name for font in font_manager.fontManager.ttflist}
    pyplot.rcdefaults()
    pyplot.rcParams.update({
        "font.family": next(font for font in FONTS if font in installed),
        "font.size": 10.5, "axes.titlesize": 11, "axes.labelsize": 10.5, "legend.fontsize": 10,
        "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": MUTED,
        "axes.titleweight": "bold", "axes.titlelocation": "left", "axes.titlepad": 8,
        "xtick.color": MUTED, "ytick.color": MUTED,
        "xtick.labelcolor": INK, "ytick.labelcolor": INK,
        "axes.linewidth": 0.7, "xtick.major.width": 0.7, "ytick.major.width": 0.7,
        "axes.spines.top": False, "axes.spines.right": False,
        "axes.grid": True, "grid.color": GRID, "grid.linewidth": 0.8, "axes.axisbelow": True,
        "axes.formatter.useoffset": False,
        "axes.formatter.limits": (-4, 5), "axes.unicode_minus": True,
        "lines.linewidth": 1.5, "lines.solid_capstyle": "round", "legend.frameon": False,
        "legend.handlelength": 1.6, "legend.borderaxespad": 0.2, "legend.columnspacing": 1.6,
        "figure.constrained_layout.use": True, "figure.dpi": 100, "savefig.dpi": 200,
        "svg.fonttype": "path", "svg.hashsalt": "apvi",
    })


def legend_above(axes, **kwargs):
    """A legend in a row above the axes, right-aligned, so that it hides no data."""
    handles, labels = axes.get_legend_handles_labels()
    if len(handles) > 0:
        across = min(len(labels), 3) if is_narrow() else len(labels)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.005), ncol=across, **kwargs)


def image_data(figure):
    """Returns the figure as a data URI and closes it."""
    buffer = io.BytesIO()
    metadata = {"Date": None, "Creator": None, "Format": None, "Type": None}
    figure.savefig(buffer, format="svg", metadata=metadata)
    pyplot.close(figure)
    text = buffer.getvalue()
    text = text[text.index(b"<svg"):]  # drops the document type, which contains a URL
    return "data:image/svg+xml;base64," + base64.b64encode(text).decode()


def display_width(figure):
    """Width of a figure on a wide screen [px]."""
    return round(figure.get_figwidth() * PIXELS_PER_INCH)
