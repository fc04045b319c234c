#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Plots the result of `apvi calibrate`: eigenvalues, semicircle, edge and threshold of both blocks.

    scripts/plot_calibration.py FOLDER [-o fit.svg]
"""
import argparse
import csv
import json
import pathlib
import sys

import numpy as np
from matplotlib import pyplot

from report.style import BLUE, MUTED, ORANGE, RED, TEAL, WIDTH, apply, legend_above

BLOCKS = {"rotation": r"rad$^{-2}$", "position": r"m$^{-2}$"}
COLORS = (BLUE, ORANGE, TEAL)
BINS = 70


class InputError(Exception):
    """An invalid input file."""


def load(folder):
    """The fits; and by kind of frame, the eigenvalues [n, 3] per block and the landmark counts [n]."""
    try:
        fits = json.loads((folder / "calibration.json").read_text(encoding="utf-8"))
        with open(folder / "eigenvalues.csv", encoding="utf-8", newline="") as file:
            rows = list(csv.reader(file))[1:]
    except (OSError, ValueError) as error:
        raise InputError(f"{folder}: {error}; is this an output folder of `apvi calibrate`?") from error
    frames = {}
    for kind in ("healthy", "blind"):
        numbers = np.array([[float(x) for x in row[2:]] for row in rows if row[1] == kind])
        numbers = numbers.reshape(-1, 7)
        frames[kind] = {"rotation": numbers[:, 1:4], "position": numbers[:, 4:7],
                        "landmarks": numbers[:, 0]}
    return fits, frames


def eigenvalues_of(frames, block, fit):
    """Eigenvalues as used by the fit."""
    values = frames[block]
    if fit["normalization"] == "per_inlier":
        values = values / np.maximum(1.0, frames["landmarks"])[:, None]
    return values


def density(x, mean, radius):
    inside = np.clip(1.0 - ((x - mean) / radius) ** 2, 0.0, None)
    return 2.0 / (np.pi * radius) * np.sqrt(inside)


def panel(axes, frames, block, fit):
    """Stacked histograms of the log10 of the three eigenvalues of a block."""
    part = fit[block]
    healthy = eigenvalues_of(frames["healthy"], block, fit)
    blind = eigenvalues_of(frames["blind"], block, fit)
    logs = np.log10(np.maximum(healthy, 1e-12))
    dark = np.log10(np.maximum(blind.min(axis=1), 1e-12)) if len(blind) else np.array([])
    low = min([logs.min(), np.log10(part["threshold"]) - 0.2, *dark])
    bins = np.linspace(low - 0.1, logs.max() + 0.1, BINS)
    weight = 1.0 / (logs.size * (bins[1] - bins[0]))
    axes.hist([logs[:, k] for k in range(3)], bins, weights=[np.full(len(logs), weight)] * 3,
              stacked=True, color=COLORS, alpha=0.75, label=["smallest", "middle", "largest"])
    if len(dark):
        axes.hist(dark, bins, weights=np.full(len(dark), 1.0 / (len(dark) * 3 * (bins[1] - bins[0]))),
                  histtype="step", color=MUTED, linewidth=1.3, label="smallest, degenerate frames")
    if part["logarithmic"]:
        x = np.linspace(part["mean"] - part["radius"], part["mean"] + part["radius"], 300)
        axes.plot(x, density(x, part["mean"], part["radius"]), color=RED, label="semicircle")
    axes.axvline(np.log10(part["edge"]), color=RED, linewidth=1.0, linestyle=":", label="edge")
    axes.axvline(np.log10(part["threshold"]), color=RED, linewidth=1.2, label="threshold")
    axes.set_xlabel(f"log10 of the eigenvalues of the {block} block [{BLOCKS[block]}"
                    + (" per inlier]" if fit["normalization"] == "per_inlier" else "]"))
    axes.set_ylabel("density")
    legend_above(axes, handletextpad=0.5)


def draw(fits, frames):
    apply()
    fit = next(f for f in fits["fits"] if f["normalization"] == fits["chosen"])
    figure, axes = pyplot.subplots(2, 1, figsize=(WIDTH, 6.2))
    for one, block in zip(axes, BLOCKS):
        panel(one, frames, block, fit)
    return figure


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("folder", type=pathlib.Path, metavar="FOLDER")
    parser.add_argument("-o", "--output", type=pathlib.Path, metavar="FILE",
                        help="output image, SVG or PNG (default: FOLDER/fit.svg)")
    arguments = parser.parse_args()
    output = arguments.output or arguments.folder / "fit.svg"
    try:
        figure = draw(*load(arguments.folder))
        figure.savefig(output, metadata={"Date": None} if output.suffix == ".svg" else None)
    except InputError as error:
        print(f"plot_calibration.py: {error}", file=sys.stderr)
        return 2
    print(output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
