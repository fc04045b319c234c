# SPDX-License-Identifier: BSD-3-Clause
"""Pages from templates, with every figure inside, once for a wide screen and once for a phone."""
import dataclasses
import pathlib

import jinja2

from . import style


@dataclasses.dataclass
class Picture:
    """A figure of a section: data URI, width on a wide screen [px], caption, alternative text."""
    data: str
    width: int
    caption: str
    alt: str
    narrow: str  # the same, drawn for a phone


def picture(make, alt, caption=""):
    """Of what `make` draws, which is called once for each width."""
    figure = make()
    width = style.display_width(figure)
    data = style.image_data(figure)
    with style.narrow():
        narrow = style.image_data(make())
    return Picture(data, width, caption, alt, narrow)


def render(page, **values):
    """A page as text."""
    folder = pathlib.Path(__file__).resolve().parent
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(folder), autoescape=True,
                                     trim_blocks=True, lstrip_blocks=True,
                                     undefined=jinja2.StrictUndefined)
    return environment.get_template(page).render(**values)


def write(text, output):
    """Writes the page in one step, so that a reader never sees half of it."""
    partial = output.with_name(output.name + ".partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(output)
