#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The viewer's page in headless Chromium, on a desktop and on a phone: browser_test.py APVI.

APVI_SCREENSHOTS names a folder for the images of the page."""
import importlib.util
import json
import os
import pathlib
import shutil
import subprocess
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
SKIPPED = 77
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


class Desktop(Case):
    def test_shows_the_view_of_the_vehicle_first(self):
        mean, deviation = self.pixels()
        self.assertGreater(min(deviation), 3)
        self.assertGreater(mean[1], mean[0])  # greenish water
        self.assertEqual(self.script("return viewer.camera.mode"), "follow")
        self.keep("follow")

    def test_layers_differ(self):
        self.choose("modes", "orbit")
        seen = self.pixels()
        means = [seen[0]]
        for layer in ("restored", "depth", "alpha", "normals"):
            self.choose("layers", layer)
            self.keep(layer)
            means.append(self.pixels()[0])
        for i, one in enumerate(means):
            for other in means[:i]:
                self.assertGreater(sum(abs(a - b) for a, b in zip(one, other)), 3)
        self.choose("layers", "depth")
        self.assertFalse(self.script("return document.getElementById('scale').hidden"))

    def test_the_slider_takes_the_water_out(self):
        set_water = """const box = document.getElementById("water"); box.value = arguments[0];
                       box.dispatchEvent(new Event("input"));"""
        shares = []
        for amount in (2, 1, 0):
            self.script(set_water, amount)
            self.rest()
            mean, _ = self.pixels()
            shares.append(mean[0] / sum(mean))  # red comes back
        self.assertEqual(shares, sorted(shares))

    def test_dragging_orbits_about_the_target(self):
        self.choose("modes", "orbit")
        self.keep("orbit")
        before = self.script("return [viewer.camera.p, viewer.camera.target]")
        self.drag(120, 40)
        self.rest()
        after = self.script("return [viewer.camera.p, viewer.camera.target]")
        distance = [sum((a - b) ** 2 for a, b in zip(p, t)) ** 0.5 for p, t in (before, after)]
        self.assertAlmostEqual(*distance, places=6)
        self.assertNotAlmostEqual(before[0][0], after[0][0], places=2)
        self.assertEqual(before[1], after[1])

    def test_keys_fly(self):
        from selenium.webdriver.common.action_chains import ActionChains
        self.choose("modes", "fly")
        before = self.script("return viewer.camera.p")
        ActionChains(self.browser).key_down("w").pause(0.4).key_up("w").perform()
        self.rest()
        self.assertNotEqual(before, self.script("return viewer.camera.p"))

    def test_time_moves_the_vehicle(self):
        set_time = """const box = document.getElementById("time"); box.value = arguments[0];
                      box.dispatchEvent(new Event("input"));"""
        self.script(set_time, 0.5)
        self.rest()
        x, y, z = self.script("return viewer.view().pose.slice(4)")
        for value, truth in zip((x, y, z), tiny_run.body_pose(30)):
            self.assertAlmostEqual(value, truth, places=2)
        self.assertEqual(self.script("return document.getElementById('clock').textContent"), "0:30 / 1:00")

    def test_playing_draws_image_after_image(self):
        before = int(self.script("return document.body.dataset.frames"))
        self.click("play")
        time.sleep(2.0)
        self.click("play")
        self.assertGreater(int(self.script("return document.body.dataset.frames")) - before, 4)
        self.assertGreater(self.script("return viewer.time"), 0.02)

    def measure(self, places):
        """Clicks these places [px from the center of the window], each once the one before is answered."""
        for count, (x, y) in enumerate(places, start=self.script("return viewer.measure.points.length") + 1):
            self.click_at(x, y)
            self.wait_for(f"viewer.measure.points.length == {count}")
            time.sleep(0.4)  # not a double click

    def look_at_a_surface(self):
        """Goes on in time until the middle of the image is not in a gap of the small map."""
        for step in range(50):
            self.script("viewer.setTime(arguments[0])", step / 50)
            self.rest()
            if self.script("return viewer.pointAt(innerWidth / 2, innerHeight / 2)"):
                return

    def meters_per_pixel(self):
        view = self.script("return viewer.view()")
        return tiny_run.DEPTH_M / (view["focal"] * view["height"])

    def test_clicks_measure_a_distance_along_points(self):
        self.click("measure")
        self.measure([(-200, 0), (-100, 0)])
        expected = 100 * self.meters_per_pixel()
        a, b = self.script("return viewer.measure.points")
        self.assertAlmostEqual(sum((p - q) ** 2 for p, q in zip(a, b)) ** 0.5, expected, delta=0.2 * expected)
        self.assertIn(" mm" if expected < 0.1 else " m", self.text("measured"))
        self.assertIn("height", self.text("measured"))
        self.measure([(-100, 100)])
        length = self.script("return pathLength(viewer.measure.points)")
        self.assertAlmostEqual(length, 2 * expected, delta=0.4 * expected)
        self.assertIn("along 3 points", self.text("measured"))
        self.keep("measure")

    def test_clicks_measure_an_area(self):
        self.click("measure")
        self.script("document.querySelector('#measure-kinds [data-value=area]').click()")
        self.assertIn("three points", self.text("measured"))
        self.measure([(-200, -60), (-80, -60), (-80, 60), (-200, 60)])
        scale = self.meters_per_pixel()
        area = self.script("return polygonArea(viewer.measure.points)")
        self.assertAlmostEqual(area, (120 * scale) ** 2, delta=0.3 * (120 * scale) ** 2)
        self.assertIn("m²", self.text("measured"))
        self.assertIn("perimeter", self.text("measured"))
        self.keep("area")

    def test_areas_are_those_of_geometry(self):
        square = "[[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]"
        self.assertAlmostEqual(self.script(f"return polygonArea({square})"), 4)
        self.assertAlmostEqual(self.script(f"return polygonArea({square}.reverse())"), 4)
        self.assertAlmostEqual(self.script(f"return pathLength({square}, true)"), 8)
        self.assertAlmostEqual(self.script(f"return pathLength({square})"), 6)
        # Not convex, with its centroid outside; in a tilted plane, where x counts twice.
        arrow = "[[0, 0, 0], [1, 1, Math.sqrt(3)], [0, 0.2, 0], [-1, 1, -Math.sqrt(3)]]"
        self.assertAlmostEqual(self.script(f"return polygonArea({arrow})"), 0.4)
        # A roof: two slopes of 1 by sqrt(2), whose edges lie in no plane.
        self.assertAlmostEqual(self.script("return polygonArea([[0, 0, 0], [1, 0, 1], [2, 0, 0], [2, 0, 0]])"), 1)
        self.assertEqual(self.script("return polygonArea([[0, 0, 0], [1, 0, 0]])"), 0)

    def test_keys_measure_too(self):
        from selenium.webdriver.common.keys import Keys
        self.look_at_a_surface()
        stage = self.browser.find_element("id", "stage")
        stage.send_keys("m")
        self.assertFalse(self.script("return document.getElementById('measure-bar').hidden"))
        for count in (1, 2):
            stage.send_keys(Keys.ENTER)
            self.wait_for(f"viewer.measure.points.length == {count}")
        stage.send_keys(Keys.BACKSPACE)
        self.assertEqual(self.script("return viewer.measure.points.length"), 1)
        stage.send_keys(Keys.CONTROL, "z")
        self.assertEqual(self.script("return viewer.measure.points.length"), 0)
        self.assertTrue(self.script("return document.getElementById('measure-undo').disabled"))
        stage.send_keys(Keys.ESCAPE)
        self.assertTrue(self.script("return document.getElementById('measure-bar').hidden"))

    def test_a_section_hides_what_is_outside(self):
        self.cut()

    def test_a_saved_view_renders_to_the_screenshot(self):
        self.choose("modes", "orbit")
        self.click("screenshot")
        self.click("save-view")
        screenshot, camera = self.downloaded("dive.png"), self.downloaded("camera.json")
        json.loads(camera.read_text())
        subprocess.run([APVI, "-q", "render", self.run_folder, "--camera", camera, "-o", self.folder / "out"],
                       check=True)
        self.assertEqual(screenshot.read_bytes(), (self.folder / "out/map.png").read_bytes())

    def test_keyframes_are_drawn(self):
        self.choose("modes", "orbit")
        self.script("""document.getElementById("stage").dispatchEvent(
            new WheelEvent("wheel", {deltaY: 1000, bubbles: true, cancelable: true}));""")  # away from the vehicle
        self.rest()
        painted = """const c = document.getElementById("overlay"); let n = 0;
          const d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
          for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n;"""
        before = self.script(painted)
        self.assertGreater(before, 500)  # the trajectory
        self.click("show-keyframes")
        self.assertGreater(self.script(painted), before + 300)
        self.keep("keyframes")

    def test_finds_the_server_again(self):
        port = self.server.port
        self.server.stop()
        self.wait_for("!document.getElementById('notice').hidden")
        type(self).server = page_client.Server(APVI, "view", self.run_folder, "--port", port)
        self.wait_for("document.getElementById('notice').hidden")
        self.browser.get_log("browser")  # of the connections that failed


class Exported(Case):
    """The page without a server."""

    @classmethod
    def serve(cls):
        cls.page = cls.folder / "page.html"
        subprocess.run([APVI, "-q", "view", cls.run_folder, "--export", cls.page], check=True)

    @classmethod
    def address(cls):
        return cls.page.as_uri()

    @classmethod
    def stop(cls):
        pass

    def keep(self, name):
        super().keep(f"exported_{name}")

    def test_a_section_hides_what_is_outside(self):
        self.cut()

    def test_only_the_section_is_measured(self):
        self.choose("modes", "orbit")
        point = "viewer.pointAt(innerWidth / 2 - 40, innerHeight / 2 + 20)"
        x, y, z = self.script(f"return {point}")
        self.choose("section-kinds", "horizontal")
        self.assertEqual(self.script(f"return {point}"), [x, y, z])
        self.slide("section-position", 0.6)
        self.rest()
        self.assertIsNone(self.script(f"return {point}"))


class Phone(Case):
    SIZE = "phone"

    def test_the_panel_opens_and_nothing_overflows(self):
        self.keep("first")
        self.assertEqual(self.script("return document.documentElement.scrollWidth - innerWidth"), 0)
        self.assertFalse(self.script("return document.getElementById('panel').offsetParent !== null"))
        self.click("panel-toggle")
        self.keep("panel")
        box = self.script("const b = document.getElementById('panel').getBoundingClientRect();"
                          "return [b.left, b.right, b.top, b.bottom, innerWidth, innerHeight]")
        self.assertGreaterEqual(box[0], 0)
        self.assertLessEqual(box[1], box[4])
        self.assertGreater(box[2], 0.3 * box[5])
        self.assertLessEqual(box[3], box[5])

    def touch(self, kind, points):
        self.browser.execute_cdp_cmd("Input.dispatchTouchEvent", {
            "type": kind, "touchPoints": [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]})

    def box(self, element):
        return self.script("const b = document.getElementById(arguments[0]).getBoundingClientRect();"
                           "return [b.left, b.right, b.top, b.bottom];", element)

    def test_taps_measure_an_area(self):
        self.click("panel-toggle")
        self.click("measure")
        self.assertTrue(self.script("return document.body.classList.contains('bare')"))  # the surface is visible
        self.script("document.querySelector('#measure-kinds [data-value=area]').click()")
        for count, place in enumerate([(120, 300), (260, 300), (260, 440), (120, 440)], start=1):
            self.touch("touchStart", [place])
            self.touch("touchEnd", [])
            self.wait_for(f"viewer.measure.points.length == {count}")
            time.sleep(0.4)
        self.assertIn("m²", self.text("measured"))
        left, right, top, bottom = self.box("measure-bar")
        self.assertGreaterEqual(left, 0)
        self.assertLessEqual(right, 390)
        self.assertGreater(top, 600)
        self.assertLess(bottom, self.box("timeline")[2])
        self.keep("area")
        self.click("measure-end")

    def test_fingers_orbit_and_zoom(self):
        self.choose("modes", "orbit")
        self.keep("orbit")
        before = self.script("return viewer.camera.p")
        touch = self.touch
        touch("touchStart", [(150, 300)])
        touch("touchMove", [(220, 320)])
        touch("touchEnd", [])
        turned = self.script("return viewer.camera.p")
        self.assertNotEqual(before, turned)
        distance = "return norm(subtract(viewer.camera.p, viewer.camera.target))"
        far = self.script(distance)
        touch("touchStart", [(180, 300), (200, 300)])
        touch("touchMove", [(100, 300), (280, 300)])
        touch("touchEnd", [])
        self.assertLess(self.script(distance), 0.5 * far)


def skip_reason():
    if CHROMIUM is None or DRIVER is None:
        return "Chromium and its driver are not installed: apt install chromium chromium-driver"
    if importlib.util.find_spec("selenium") is None:
        return "apt install python3-selenium"
    done = subprocess.run([APVI, "view", "--help"], capture_output=True, text=True)
    return "this build has no mapping" if "not in this build" in done.stdout else None


if __name__ == "__main__":
    if skip_reason():
        print(f"skipped: {skip_reason()}")
        sys.exit(SKIPPED)
    unittest.main(argv=[sys.argv[0], "-v", *sys.argv[1:]])
