#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Opens reports in headless Chromium, without a network: every picture is there, on a wide screen, on a
phone and on paper. Skips where there is no Chromium."""
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
# Says what it sees in an element of its own, after everything has been decoded.
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
        capture_output=True, text=True, timeout=120, check=False)


class Browser(report_test.Case):
    def seen(self, html, width):
        """What the page's probe says on a screen of this width."""
        page = self.folder.run / "probed.html"
        page.write_text(html.replace("</body>", PROBE + "</body>"), encoding="utf-8")
        for _ in range(3):  # on a busy machine the browser's time may end before the page is drawn
            result = chromium(self.folder.run, "--dump-dom", f"--window-size={width},900", f"file://{page}")
            found = re.search(r'<pre id="probe">(.*?)</pre>', result.stdout, re.DOTALL)
            if found and found.group(1):
                return json.loads(found.group(1))
        self.fail(f"the page's probe says nothing: {result.stdout[-300:]} {result.stderr[-500:]}")

    def assert_pictures(self, seen, count):
        self.assertEqual(len(seen["images"]), count)
        for name, natural, width, height in seen["images"]:
            self.assertGreater(natural, 0, f"{name} is broken")
            self.assertGreater(min(width, height), 40, f"{name} is not to be seen")

    def whole_run(self):
        report_test.add_camera_and_map(self.folder)
        return self.make()

    def test_every_picture_of_a_run_is_there(self):
        html = self.whole_run()
        count = html.count("<img ")
        self.assertGreater(count, 25)
        wide = self.seen(html, 1280)
        self.assert_pictures(wide, count)
        self.assertEqual(wide["narrow"], 0)
        phone = self.seen(html, 390)
        self.assert_pictures(phone, count)
        self.assertEqual(phone["narrow"], 13)
        self.assertLessEqual(phone["overflow"], 0)

    def test_the_line_between_two_pictures_follows_the_hand(self):
        self.assertIn("20%", self.seen(self.whole_run(), 1280)["at"])

    def test_a_run_prints(self):
        page, paper = self.folder.run / "page.html", self.folder.run / "page.pdf"
        page.write_text(self.whole_run(), encoding="utf-8")
        chromium(self.folder.run, f"--print-to-pdf={paper}", f"file://{page}")
        self.assertTrue(paper.read_bytes().startswith(b"%PDF"))
        self.assertGreater(paper.stat().st_size, 30_000)

    def test_every_picture_of_a_sweep_is_there(self):
        html = report_test.SweepFolder.make_sweep(self)
        for width in (1280, 390):
            self.assert_pictures(self.seen(html, width), 1)

    # What make_sweep needs.
    SUMMARY = report_test.SweepFolder.SUMMARY


def why_not():
    if CHROMIUM is None:
        return "no Chromium here: apt install chromium"
    if report_test.MISSING:
        return f"apt install {' '.join('python3-' + name for name in report_test.MISSING)}"
    return None


if __name__ == "__main__":
    if why_not():
        print(f"skipped: {why_not()}")
        sys.exit(SKIPPED)
    sys.path.insert(0, str(report_test.SCRIPTS))
    unittest.main(argv=[sys.argv[0], *(sys.argv[1:] or ["Browser"])])
