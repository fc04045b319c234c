# SPDX-License-Identifier: BSD-3-Clause
"""Renders page templates with embedded figures, in versions for wide screens and phones."""
import dataclasses
import pathlib

import jinja2

from . import style


@dataclasses.dataclass
class Plot:
    """A figure of a section: data URI, width on a wide screen [px], caption, alternative text."""
    data: str
    width: int
    caption: str
    alt: str
    narrow: str  # data URI of the version for phones


def plot(make, alt, caption=""):
    """Creates a Plot; `make` returns the figure and is called once per width."""
    figure = make()
    width = style.display_width(figure)
    data = style.image_data(figure)
    with style.narrow():
        narrow = style.image_data(make())
    return Plot(data, width, caption, alt, narrow)


def render(page, **values):
    """Returns the HTML page."""
    folder = pathlib.Path(__file__).resolve().parent
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(folder), autoescape=True,
                                     trim_blocks=True, lstrip_blocks=True,
                                     undefined=jinja2.StrictUndefined)
    return environment.get_template(page).render(**values)


def write(text, output):
    """Writes the page atomically."""
    partial = output.with_name(output.name + ".partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(output)
