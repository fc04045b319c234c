#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Composes an image of a held-out view of a run: camera image, rendered map, map without water, depth.

    scripts/compose_view.py RUN STAMP IMAGE.jpg

docs/images/map_seabed_easy.jpg shows view 1700000008000000000 of the run in docs/benchmarks.md that was
refined to 1570 iterations.
"""
import pathlib
import sys

from PIL import Image, ImageDraw, ImageFont

from report import map_figures

GAP = 6  # between the panels [px]
FONT = "/usr/share/fonts/truetype/liberation/LiberationSans-Regular.ttf"
KINDS = {"truth": "camera", "render": "map", "restored": "without water", "depth": "depth"}


def load(renders, stamp, kind):
    path = renders / f"{stamp}_{kind}.png"
    if kind == "depth":
        image, _ = map_figures.depth_image(path)
        return image
    return Image.open(path).convert("RGB")


def draw_label(image, text):
    draw = ImageDraw.Draw(image, "RGBA")
    try:
        font = ImageFont.truetype(FONT, 15)
    except OSError:
        font = ImageFont.load_default()
    x0, y0, x1, y1 = draw.textbbox((0, 0), text, font=font)
    left, top = 8, image.height - (y1 - y0) - 18
    draw.rounded_rectangle((left, top, left + x1 - x0 + 16, top + y1 - y0 + 10), 9, fill=(20, 28, 36, 160))
    draw.text((left + 8 - x0, top + 5 - y0), text, font=font, fill="white")


def main():
    if len(sys.argv) != 4:
        print(__doc__.strip(), file=sys.stderr)
        return 2
    renders, stamp, output = pathlib.Path(sys.argv[1]) / "renders", sys.argv[2], sys.argv[3]
    try:
        panels = [load(renders, stamp, kind) for kind in KINDS]
    except OSError as error:
        print(f"compose_view.py: {error}", file=sys.stderr)
        return 2
    width, height = panels[0].size
    sheet = Image.new("RGB", (len(panels) * (width + GAP) - GAP, height), "white")
    for i, (panel, text) in enumerate(zip(panels, KINDS.values())):
        draw_label(panel, text)
        sheet.paste(panel, (i * (width + GAP), 0))
    sheet.save(output, quality=90, optimize=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
