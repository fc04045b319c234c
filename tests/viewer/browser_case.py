# SPDX-License-Identifier: BSD-3-Clause
"""The viewer's page in headless Chromium, for the tests of browser_test.py."""
import importlib.util
import os
import pathlib
import shutil
import sys
import tempfile
import time
import unittest

import page_client
import tiny_run

ROOT = pathlib.Path(__file__).resolve().parents[2]
APVI = sys.argv.pop(1) if len(sys.argv) > 1 else str(ROOT / "build/cpu/bin/apvi")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")
SIZES = {"desktop": (1280, 800), "phone": (390, 844)}


def open_browser(folder, name):
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader",
                     "--hide-scrollbars", f"--user-data-dir={folder}/{name}"):
        options.add_argument(argument)
    options.add_experimental_option("prefs", {"download.default_directory": str(folder)})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = webdriver.Chrome(service=Service(DRIVER), options=options)
    browser.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(folder)})
    width, height = SIZES[name]
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
        "width": width, "height": height, "deviceScaleFactor": 1, "mobile": name == "phone"})
    return browser


class Case(unittest.TestCase):
    SIZE = "desktop"

    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.run_folder = tiny_run.make(cls.folder / "dive")
        cls.browser = open_browser(cls.folder, cls.SIZE)
        cls.serve()

    @classmethod
    def serve(cls):
        cls.server = page_client.Server(APVI, "view", cls.run_folder, "--port", 0)

    @classmethod
    def stop(cls):
        cls.server.stop()

    @classmethod
    def address(cls):
        return cls.server.url

    @classmethod
    def tearDownClass(cls):
        cls.browser.quit()
        cls.stop()
        cls.temporary.cleanup()

    def setUp(self):
        self.browser.get(self.address())
        self.wait_for("document.body.dataset.frames > 0")
        self.rest()

    def tearDown(self):
        errors = [entry for entry in self.browser.get_log("browser") if entry["level"] == "SEVERE"]
        self.assertEqual(errors, [])

    def script(self, code, *arguments):
        return self.browser.execute_script(code, *arguments)

    def wait_for(self, condition, seconds=120):
        end = time.monotonic() + seconds
        while not self.script(f"return Boolean({condition})"):
            self.assertLess(time.monotonic(), end, condition)
            time.sleep(0.05)

    def rest(self):
        """Waits for the complete image of the newest view, and until no other has come for a while."""
        self.wait_for("!viewer.dirty && Number(document.body.dataset.complete) === viewer.viewId")
        before = None
        while before != (now := self.script("return document.body.dataset.frames")):
            before = now
            time.sleep(0.5)

    def click(self, element):
        self.script("document.getElementById(arguments[0]).click()", element)

    def text(self, element):
        return self.script("return document.getElementById(arguments[0]).textContent", element)

    def choose(self, group, value):
        self.script("document.querySelector(`#${arguments[0]} [data-value=${arguments[1]}]`).click()", group, value)
        self.rest()

    def pixels(self):
        """Mean color of the image, and its standard deviation."""
        return self.script("""
          const image = document.getElementById("image");
          const data = image.getContext("2d").getImageData(0, 0, image.width, image.height).data;
          const sum = [0, 0, 0], square = [0, 0, 0];
          for (let i = 0; i < data.length; ++i) if (i % 4 < 3) { sum[i % 4] += data[i]; square[i % 4] += data[i] ** 2; }
          const n = data.length / 4;
          return [sum.map(x => x / n), square.map((x, k) => Math.sqrt(Math.max(0, x / n - (sum[k] / n) ** 2)))];""")

    def drag(self, dx, dy):
        from selenium.webdriver.common.action_chains import ActionChains
        stage = self.browser.find_element("id", "stage")
        ActionChains(self.browser).move_to_element_with_offset(stage, -150, 0).click_and_hold().move_by_offset(
            dx, dy).release().perform()

    def click_at(self, x, y):
        from selenium.webdriver.common.action_chains import ActionChains
        stage = self.browser.find_element("id", "stage")
        ActionChains(self.browser).move_to_element_with_offset(stage, x, y).click().perform()

    def keep(self, name):
        folder = os.environ.get("APVI_SCREENSHOTS")
        if folder:
            self.browser.save_screenshot(f"{folder}/{self.SIZE}_{name}.png")

    def downloaded(self, name):
        file = self.folder / name
        end = time.monotonic() + 120
        while not file.exists() or file.stat().st_size == 0:
            self.assertLess(time.monotonic(), end, name)
            time.sleep(0.1)
        return file


    def box(self, element):
        return self.script("const b = document.getElementById(arguments[0]).getBoundingClientRect();"
                           "return [b.left, b.right, b.top, b.bottom];", element)

    def slide(self, element, value):
        self.script("const box = document.getElementById(arguments[0]); box.value = arguments[1];"
                    "box.dispatchEvent(new Event('input'));", element, value)

    def cut(self):
        """Cuts the seabed, 0.5 m high, at three heights and from a side."""
        self.choose("modes", "orbit")
        self.choose("layers", "alpha")
        whole = self.pixels()[0][0]
        self.choose("section-kinds", "horizontal")
        self.slide("section-thickness", -2)
        covered = []
        for position in (-0.5, 0, 0.5):
            self.slide("section-position", position)
            self.rest()
            covered.append(self.pixels()[0][0])
            if position == 0:
                self.keep("section_horizontal")
        self.assertLess(covered[0], 0.1 * whole)
        self.assertLess(covered[2], 0.1 * whole)
        self.assertGreater(covered[1], 2 * covered[0])
        self.assertLess(covered[1], 0.8 * whole)
        self.choose("layers", "seen")
        self.choose("section-kinds", "vertical")
        self.slide("section-position", 0.1)
        self.slide("section-thickness", -1)
        self.slide("section-direction", 30)
        self.click("section-look")
        self.rest()
        self.keep("section_vertical")
        self.assertEqual(self.script("return viewer.camera.mode"), "orbit")
        self.assertFalse(self.script("return document.getElementById('section-direction-row').hidden"))
        normal, offset, thickness = self.script(
            "const s = viewer.view().section; return [s.normal, s.offset, s.thickness]")
        # The camera looks along the normal at the middle of the section.
        ahead = self.script("return rotate(viewer.camera.q, [0, 0, 1])")
        self.assertAlmostEqual(sum(a * n for a, n in zip(ahead, normal)), -1, places=6)
        self.assertAlmostEqual(sum(t * n for t, n in zip(self.script("return viewer.camera.target"), normal)), offset,
                               places=6)
        self.assertAlmostEqual(thickness, 0.1 * self.script("return viewer.scene.radius_m"), places=6)
        self.choose("section-kinds", "none")
        self.assertIsNone(self.script("return viewer.view().section"))


def skip_reason():
    if CHROMIUM is None or DRIVER is None:
        return "Chromium and its driver are not installed: apt install chromium chromium-driver"
    if importlib.util.find_spec("selenium") is None:
        return "apt install python3-selenium"
    return page_client.why_no_viewer(APVI)
