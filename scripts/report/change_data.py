# SPDX-License-Identifier: BSD-3-Clause
"""Reads the output of `apvi diff`: changes.json and the images that it names."""
import base64
import dataclasses
import json
import pathlib

from .run_data import InputError


@dataclasses.dataclass
class Pair:
    """Images before and after as data URIs, with their size [px]."""
    before: str
    after: str
    width: int
    height: int


@dataclasses.dataclass
class ChangeMap:
    folder: pathlib.Path
    content: dict   # of changes.json
    plan: Pair      # the place from above
    marked: str     # data URI of the place with the changes marked
    pairs: dict     # Pair by the id of a change


def is_change_map(folder):
    return (folder / "changes.json").is_file()


def read_png(path):
    """(data URI, width, height). Throws InputError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    if data[:8] != b"\x89PNG\r\n\x1a\n" or len(data) < 24:
        raise InputError(f"{path}: not a PNG file")
    width, height = (int.from_bytes(data[i:i + 4], "big") for i in (16, 20))
    return "data:image/png;base64," + base64.b64encode(data).decode(), width, height


def read_pair(before, after):
    first, width, height = read_png(before)
    return Pair(first, read_png(after)[0], width, height)


def load(folder):
    """Throws InputError."""
    path = folder / "changes.json"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        changes = content["changes"]
        pairs = {change["id"]: read_pair(folder / f"{change['images']}_before.png",
                                         folder / f"{change['images']}_after.png")
                 for change in changes}
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise InputError(f"{path}: not a change map: {error}") from error
    plan = read_pair(folder / "before.png", folder / "after.png")
    return ChangeMap(folder, content, plan, read_png(folder / "changes.png")[0], pairs)
