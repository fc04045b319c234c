# SPDX-License-Identifier: BSD-3-Clause
"""Figures of the map compared with the ground truth, and of the estimated water."""
import base64
import dataclasses
import io

import numpy as np
from matplotlib import colormaps, pyplot
from PIL import Image

from . import style

MAX_VIEWS = 6
MAX_WIDTH = 960  # of an image in the page [px]
CHANNELS = (("red", "#c4303b"), ("green", "#12866f"), ("blue", "#1565b0"))


@dataclasses.dataclass
class View:
    """A held-out view: images as data URIs by kind."""
    name: str
    width: int
    height: int
    images: dict


def jpeg(image):
    buffer = io.BytesIO()
    image.convert("RGB").save(buffer, format="JPEG", quality=88, optimize=True)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()


def fitted(image):
    if image.width <= MAX_WIDTH:
        return image
    return image.resize((MAX_WIDTH, round(image.height * MAX_WIDTH / image.width)), Image.LANCZOS)


def depth_image(path):
    """Depth image in false colors (black: no depth), and the depth range of the colors [m]."""
    depth = np.asarray(Image.open(path), dtype=float) * 1e-3
    there = depth > 0.0
    if not there.any():
        return None, None
    near, far = np.quantile(depth[there], (0.02, 0.98))
    part = np.clip((depth - near) / max(far - near, 1e-6), 0.0, 1.0)
    colors = (255.0 * colormaps["turbo_r"](part)[..., :3]).astype(np.uint8)
    colors[~there] = 0
    return Image.fromarray(colors), (near, far)


def view(run, stamp):
    files = dict(run.renders[stamp])
    clear = run.dataset / "truth" / "clear" / f"{stamp}.png" if run.dataset else None
    if clear is not None and clear.is_file():
        files["clear"] = clear
    images, size = {}, (4, 3)
    for kind in ("truth", "render", "restored", "clear"):
        if kind in files:
            image = fitted(Image.open(files[kind]))
            images[kind], size = jpeg(image), image.size
    if "depth" in files:
        image, span = depth_image(files["depth"])
        if image is not None:
            images["depth"] = jpeg(fitted(image))
            images["depth_label"] = f"depth, {span[0]:.1f} to {span[1]:.1f} m"
    return View(stamp, *size, images)


def views(run):
    """Up to MAX_VIEWS views, evenly over the run, preferably with camera images; and their count."""
    stamps = [s for s, kinds in run.renders.items() if "render" in kinds and "truth" in kinds]
    stamps = stamps or list(run.renders)
    chosen = np.unique(np.linspace(0, len(stamps) - 1, MAX_VIEWS).round().astype(int))
    return [view(run, stamps[i]) for i in chosen] if stamps else [], len(stamps)


def view_panels(run):
    """(title, [(values, color, name)]) of the panels available from views.csv."""
    table = run.views
    if table is None or not np.issubdtype(table["image"].dtype, np.number):
        return []
    panels = [("PSNR [dB]", [("psnr_db", style.BLUE, "map"),
                             ("psnr_median_image_db", style.REFERENCE, "median image")]),
              ("depth, RMSE [m]", [("depth_rmse_m", style.ORANGE, None)]),
              ("without water, PSNR [dB]", [("restored_psnr_db", style.TEAL, None)])]
    found = [(title, [(table[key], color, name) for key, color, name in curves
                      if key in table and np.isfinite(table[key]).any()])
             for title, curves in panels]
    return [(title, curves) for title, curves in found if curves]


def views_over_time(run):
    """Metrics of every held-out view over time."""
    panels = view_panels(run)
    figure, all_axes = pyplot.subplots(len(panels), 1, squeeze=False, sharex=True,
                                       figsize=(style.WIDTH, 0.5 + 1.7 * len(panels)))
    time = run.views["image"] * 1e-9 - run.start_s
    for axes, (title, curves) in zip(all_axes.flat, panels):
        for values, color, name in curves:
            axes.plot(time, values, color=color, marker="o", markersize=3.5, linestyle="none",
                      label=name)
        axes.set_title(title, fontweight="normal")
        if len(curves) > 1:
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    all_axes[-1][0].set_xlabel("time [s]")
    return figure


def water(run):
    """Medium coefficients by color channel, with the ground truth where it is known."""
    figure, all_axes = pyplot.subplots(
        1, 3, figsize=(style.WIDTH, 2.6 if not style.is_narrow() else 2.2), sharey=False)
    titles = {"beta_d": "attenuation β_d [1/m]", "beta_b": "backscatter β_b [1/m]",
              "b_inf": "veiling light B∞"}
    if style.is_narrow():
        titles = {"beta_d": "β_d [1/m]", "beta_b": "β_b [1/m]", "b_inf": "B∞"}
    for axes, (key, title) in zip(all_axes, titles.items()):
        x = np.arange(3)
        values = run.medium.get(key, [np.nan] * 3)
        axes.bar(x, values, width=0.62, color=[color for _, color in CHANNELS], alpha=0.85)
        if run.true_medium and key in run.true_medium:
            for i, value in enumerate(run.true_medium[key]):
                axes.plot([i - 0.4, i + 0.4], [value, value], color=style.INK, linewidth=2.2)
        axes.set_xticks(x, [name if not style.is_narrow() else name[0] for name, _ in CHANNELS])
        axes.set_title(title, fontweight="normal")
        axes.grid(visible=False, axis="x")
        axes.set_ylim(bottom=0.0)
    return figure


def medium_columns(run):
    """Columns of mapping.csv with the medium coefficients, by coefficient."""
    names = {"beta_d": [], "beta_b": [], "b_inf": []}
    if run.mapping is None:
        return {}
    for key, found in names.items():
        found += [f"{key}_{c}" for c in "rgb" if f"{key}_{c}" in run.mapping]
    return {key: found for key, found in names.items() if len(found) == 3}


def progress_panels(run):
    """(title, [(column, color, name)]) of the panels available from mapping.csv."""
    panels = []
    for column, title in (("psnr_heldout", "held-out views, PSNR [dB]"), ("gaussians", "Gaussians")):
        if run.mapping is not None and column in run.mapping and np.isfinite(
                run.mapping[column]).any():
            panels.append((title, [(column, style.BLUE, None)]))
    for key, found in medium_columns(run).items():
        title = {"beta_d": "β_d [1/m]", "beta_b": "β_b [1/m]", "b_inf": "B∞"}[key]
        panels.append((title, [(name, color, None) for name, (_, color) in zip(found, CHANNELS)]))
    return panels


def progress(run):
    """Progress of the map over optimization time."""
    panels = progress_panels(run)
    across = 1 if style.is_narrow() else min(len(panels), 2)
    down = -(-len(panels) // across)
    figure, all_axes = pyplot.subplots(down, across, figsize=(style.WIDTH, 0.4 + 2.3 * down),
                                       squeeze=False, sharex=True)
    for axes, (title, curves) in zip(all_axes.flat, panels):
        for column, color, name in curves:
            axes.plot(run.mapping["time"], run.mapping[column], color=color, label=name)
        axes.set_title(title, fontweight="normal")
    for spare in list(all_axes.flat)[len(panels):]:
        spare.remove()
    for axes in all_axes[-1]:
        axes.set_xlabel("optimization time [s]")
    return figure
