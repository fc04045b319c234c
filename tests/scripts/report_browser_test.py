#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Opens reports in headless Chromium without network access and checks that all images are shown on a wide
screen, on a phone and in print. Skipped without Chromium."""
import json
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

import report_test

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
SKIPPED = 77
# Writes image sizes to an element of its own after all images are decoded.
PROBE = """<pre id="probe"></pre><script>addEventListener("load", async () => {
const images = [...document.images];
await Promise.all(images.map(i => i.decode().catch(() => {})));
const box = document.querySelector(".compare input");
let at = null;
if (box) { box.value = 20; box.dispatchEvent(new Event("input", {bubbles: true}));
  at = getComputedStyle(box.parentElement.querySelector(".over")).clipPath; }
document.getElementById("probe").textContent = JSON.stringify({
  width: innerWidth, overflow: document.documentElement.scrollWidth - innerWidth, at: at,
  images: images.map(i => [i.alt, i.naturalWidth, i.clientWidth, i.clientHeight]),
  narrow: images.filter(i => i.parentElement.tagName == "PICTURE" && i.currentSrc != i.src).length});
});</script>"""


def chromium(folder, *arguments):
    return subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
         "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder}/profile",
         "--virtual-time-budget=10000", *arguments],
        capture_output=True, text=True, timeout=600, check=False)


class Browser(report_test.Case):
    def probed(self, html, width):
        """Output of the probe on a screen of this width."""
        page = self.folder.run / "probed.html"
        page.write_text(html.replace("</body>", PROBE + "</body>"), encoding="utf-8")
        for _ in range(3):  # on a busy machine the time budget may end before the page is drawn
            result = chromium(self.folder.run, "--dump-dom", f"--window-size={width},900", f"file://{page}")
            found = re.search(r'<pre id="probe">(.*?)</pre>', result.stdout, re.DOTALL)
            if found and found.group(1):
                return json.loads(found.group(1))
        self.fail(f"no output of the probe: {result.stdout[-300:]} {result.stderr[-500:]}")

    def assert_images(self, probed, count):
        self.assertEqual(len(probed["images"]), count)
        for name, natural, width, height in probed["images"]:
            self.assertGreater(natural, 0, f"{name} is broken")
            self.assertGreater(min(width, height), 40, f"{name} is not visible")

    def whole_run(self):
        report_test.add_camera_and_map(self.folder)
        return self.make()

    def test_shows_all_images_of_a_run(self):
        html = self.whole_run()
        count = html.count("<img ")
        self.assertGreater(count, 25)
        wide = self.probed(html, 1280)
        self.assert_images(wide, count)
        self.assertEqual(wide["narrow"], 0)
        phone = self.probed(html, 390)
        self.assert_images(phone, count)
        self.assertEqual(phone["narrow"], 13)
        self.assertLessEqual(phone["overflow"], 0)

    def test_slider_moves_the_comparison_line(self):
        self.assertIn("20%", self.probed(self.whole_run(), 1280)["at"])

    def test_prints_to_pdf(self):
        page, paper = self.folder.run / "page.html", self.folder.run / "page.pdf"
        page.write_text(self.whole_run(), encoding="utf-8")
        chromium(self.folder.run, f"--print-to-pdf={paper}", f"file://{page}")
        self.assertTrue(paper.read_bytes().startswith(b"%PDF"))
        self.assertGreater(paper.stat().st_size, 30_000)

    def test_shows_all_images_of_a_sweep(self):
        html = report_test.SweepFolder.make_sweep(self)
        for width in (1280, 390):
            self.assert_images(self.probed(html, width), 1)

    # Used by make_sweep.
    SUMMARY = report_test.SweepFolder.SUMMARY


def skip_reason():
    if CHROMIUM is None:
        return "Chromium is not installed: apt install chromium"
    if report_test.MISSING:
        return f"apt install {' '.join('python3-' + name for name in report_test.MISSING)}"
    return None


if __name__ == "__main__":
    if skip_reason():
        print(f"skipped: {skip_reason()}")
        sys.exit(SKIPPED)
    sys.path.insert(0, str(report_test.SCRIPTS))
    unittest.main(argv=[sys.argv[0], *(sys.argv[1:] or ["Browser"])])
