# SPDX-License-Identifier: BSD-3-Clause
"""Report page of a change map: the place from above, then each change before and after."""
import datetime
import pathlib

from . import template

TITLES = {"appeared": "appeared", "vanished": "vanished", "color": "color changed"}


def area_text(square_meters):
    return f"{square_meters:.0f}" if square_meters >= 10 else f"{square_meters:.2g}"


def centimeters(meters):
    return f"{100 * meters:.0f} cm"


def place_text(change):
    return ", ".join(f"{value:.2f}" for value in change["center_m"])


def css_color(values):
    """A CSS color of image values, or None."""
    return None if values is None else "rgb({:.0f}, {:.0f}, {:.0f})".format(*(255 * v for v in values))


def facts(change):
    """(label, text) of a change."""
    rows = [("place [m]", place_text(change)),
            ("size", f"{centimeters(change['length_m'])} × {centimeters(change['width_m'])}")]
    if "relief_m" in change:
        rows.append(("distance of the surfaces", centimeters(change["relief_m"])))
    if "factors" in change:
        rows.append(("red, green, blue times", ", ".join(f"{f:.2f}" for f in change["factors"])))
    if "moved_from" in change:
        rows.append(("perhaps moved from", f"no. {change['moved_from']}"))
    rows.append(("views that decided", f"{change['views']:.0f}"))
    rows.append(("confidence", f"{100 * change['confidence']:.0f} %"))
    return rows


def headline(content):
    counts = content["counts"]
    unknown = content["only_before_m2"] + content["only_after_m2"]
    return [(str(counts["appeared"]), "", "appeared"), (str(counts["vanished"]), "", "vanished"),
            (str(counts["color"]), "", "of another color"),
            (area_text(content["compared_m2"]), "m²", "compared"),
            (area_text(unknown), "m²", "unknown: not seen in both dives")]


def alignment_text(content):
    found = content["registration"]
    return (f"Between the maps a motion of {centimeters(found['shift_m'])} and "
            f"{found['turn_deg']:.2f}° was taken out; unchanged surfaces are "
            f"{1000 * found['residual_m']:.0f} mm apart (standard deviation). Changes shorter than "
            f"{centimeters(content['min_size_m'])} are not listed.")


def cards(data):
    return [{"title": f"{change['id']} · {TITLES.get(change['kind'], change['kind'])}",
             "kind": change["kind"], "pair": data.pairs[change["id"]], "facts": facts(change),
             "colors": [(label, css_color(change.get(key)))
                        for label, key in (("before", "color_before"), ("after", "color_after"))
                        if change.get(key) is not None]}
            for change in data.content["changes"]]


def render(data):
    """Returns the HTML page."""
    content = data.content
    date = datetime.datetime.fromtimestamp((data.folder / "changes.json").stat().st_mtime)
    names = [pathlib.PurePath(content[key]).name for key in ("before", "after")]
    return template.render("change.html.j2", name=f"{names[0]} → {names[1]}",
                           subtitle=[f"changes between two dives, {date:%Y-%m-%d %H:%M}"],
                           headline=headline(content), sections=[], plan=data.plan,
                           marked=data.marked, alignment=alignment_text(content), cards=cards(data))
