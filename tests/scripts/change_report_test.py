#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Tests of scripts/report.py on the folder of a change map."""
import importlib.util
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile
import unittest
import zlib

SCRIPTS = pathlib.Path(__file__).resolve().parents[2] / "scripts"
NEEDED = ("jinja2", "matplotlib", "numpy")
SKIPPED = 77  # exit status that ctest treats as "skipped"

CONTENT = {
    "before": "runs/reef <1>", "after": "runs/reef 2", "min_size_m": 0.1,
    "counts": {"appeared": 1, "vanished": 0, "color": 1}, "compared_m2": 41.7,
    "only_before_m2": 3.0, "only_after_m2": 2.4,
    "registration": {"shift_m": 0.031, "turn_deg": 0.4, "bend_m": 0.002, "residual_m": 0.006},
    "changes": [
        {"id": 1, "kind": "appeared", "center_m": [1.0, 2.5, -8.0], "length_m": 0.31, "width_m": 0.2,
         "relief_m": 0.12, "views": 14, "confidence": 0.97, "color_after": [1.0, 0.5, 0.0],
         "images": "images/001_appeared"},
        {"id": 2, "kind": "color", "center_m": [0.0, 0.0, -8.0], "length_m": 0.6, "width_m": 0.5,
         "views": 20, "confidence": 0.8, "color_before": [0.1, 0.1, 0.1], "color_after": [0.8, 0.8, 0.8],
         "factors": [1.6, 1.5, 1.4], "images": "images/002_color"}]}


def png(width, height):
    """A gray PNG file."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + b"\x80" * width for _ in range(height))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


class ChangeReport(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = pathlib.Path(temporary.name)
        (self.folder / "images").mkdir()
        (self.folder / "changes.json").write_text(json.dumps(CONTENT), encoding="utf-8")
        for name in ("before", "after", "changes"):
            (self.folder / f"{name}.png").write_bytes(png(40, 20))
        for change in CONTENT["changes"]:
            for side in ("before", "after"):
                (self.folder / f"{change['images']}_{side}.png").write_bytes(png(32, 32))

    def report(self):
        return subprocess.run([sys.executable, SCRIPTS / "report.py", self.folder], capture_output=True,
                              text=True, check=False)

    def page(self):
        result = self.report()
        self.assertEqual(result.returncode, 0, result.stderr)
        return (self.folder / "report.html").read_text(encoding="utf-8")

    def test_headline_counts_changes_and_areas(self):
        html = self.page()
        tiles = re.findall(r"<b>([^<]*)<small>([^<]*)</small></b><span>([^<]*)</span>", html)
        self.assertEqual([value for value, _, _ in tiles], ["1", "0", "1", "42", "5.4"])
        self.assertIn("unknown", tiles[-1][2])

    def test_every_change_has_a_slider_and_its_facts(self):
        html = self.page()
        self.assertEqual(html.count('type="range"'), 3)
        for text in ("1 · appeared", "2 · color changed", "31 cm × 20 cm", "1.60, 1.50, 1.40",
                     "rgb(255, 128, 0)", "1.00, 2.50, -8.00"):
            self.assertIn(text, html)

    def test_page_is_self_contained_and_escapes_names(self):
        html = self.page()
        self.assertEqual(re.findall(r'https?://\S*|(?:href|src|srcset)="(?!#|data:)[^"]*', html), [])
        self.assertIn("reef &lt;1&gt; → reef 2", html)

    def test_missing_image_is_an_input_error(self):
        (self.folder / "images/002_color_after.png").unlink()
        result = self.report()
        self.assertEqual(result.returncode, 2)
        self.assertIn("002_color_after.png", result.stderr)

    def test_invalid_list_is_an_input_error(self):
        (self.folder / "changes.json").write_text('{"changes": [{}]}', encoding="utf-8")
        result = self.report()
        self.assertEqual(result.returncode, 2)
        self.assertIn("not a change map", result.stderr)


if __name__ == "__main__":
    missing = [name for name in NEEDED if not importlib.util.find_spec(name)]
    if missing:
        print(f"skipped: apt install {' '.join('python3-' + name for name in missing)}")
        sys.exit(SKIPPED)
    unittest.main()
