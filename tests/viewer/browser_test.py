#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The viewer's page in headless Chromium, on a desktop and on a phone: browser_test.py APVI.

APVI_SCREENSHOTS names a folder for the images of the page."""
import json
import math
import subprocess
import time

import page_client
import tiny_run
from browser_case import APVI, Case, skip_reason


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
        self.assertLess(self.box("measure-bar")[1], self.box("panel")[0])
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

    PAINTED = """const c = document.getElementById("overlay"); let n = 0;
      const d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data;
      for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n;"""

    def test_loops_join_the_poses(self):
        self.choose("modes", "orbit")
        self.script("viewer.camera.zoom(3); viewer.changed();")
        self.rest()
        before = self.script(self.PAINTED)
        self.click("show-loops")
        self.assertGreater(self.script(self.PAINTED), before + 100)
        lines = self.script("return loopLines(viewer.scene)")
        self.assertEqual(len(lines), len(tiny_run.LOOPS))
        for line, loop in zip(lines, tiny_run.LOOPS):
            for point, second in zip(line, loop):
                for value, truth in zip(point, tiny_run.body_pose(second)):
                    self.assertAlmostEqual(value, truth, places=2)
        self.keep("loops")
        self.click("show-loops")
        self.assertEqual(self.script(self.PAINTED), before)

    def test_beams_reach_from_the_vehicle_to_the_bottom(self):
        self.wait_for("viewer.scene.beams")
        self.choose("modes", "orbit")
        self.slide("time", 0.25)
        self.script("viewer.camera.zoom(3); viewer.changed();")
        self.rest()
        before = self.script(self.PAINTED)
        self.click("show-beams")
        self.assertGreater(self.script(self.PAINTED), before + 100)
        self.keep("beams")
        beams = self.script("return beamLines(viewer.scene, viewer.time)")
        self.assertEqual([beam["valid"] for beam in beams], [True, True, True, False])
        self.assertEqual([beam["measured"] for beam in beams], [True, True, True, False])
        x, y = tiny_run.body_pose(15)[:2]  # the DVL is 0.2 m ahead of it
        for beam in beams:
            self.assertAlmostEqual(math.dist(beam["from"], (x, y, 0)), 0.2, places=2)
            self.assertLess(beam["to"][2], -2)
        self.assertAlmostEqual(math.dist(beams[0]["from"], beams[0]["to"]), tiny_run.RANGE_M, places=2)
        self.slide("time", 0.55)  # without bottom lock
        self.assertEqual([b["valid"] for b in self.script("return beamLines(viewer.scene, viewer.time)")], [False] * 4)
        self.rest()
        self.keep("beams_invalid")
        self.click("show-beams")

    def test_the_timeline_shows_the_gaps_of_sensors(self):
        names = self.script("return [...document.getElementById('sensor-names').children].map((x) => x.textContent)")
        self.assertEqual(names, ["Camera", "IMU", "DVL", "Pressure"])
        label = self.script("return document.getElementById('sensors').getAttribute('aria-label')")
        self.assertEqual(label, "Camera: silent for 5.0 s, 1 gap; IMU: no gap; DVL: silent for 6.0 s, 1 gap; "
                                "Pressure: silent for 5.0 s, 1 gap")
        late = "return spansUntilNow({live: arguments[0], stamps: [1, 9]}, [[1, 4], [5, 8]])"
        self.assertEqual(self.script(late, True), [[1, 4], [5, 9]])  # the next message will say so
        self.assertEqual(self.script(late, False), [[1, 4], [5, 8]])
        red = """const c = document.getElementById("sensors"), rows = 4, row = arguments[0], at = arguments[1];
          const d = c.getContext("2d").getImageData(Math.round(at * c.width), (row + 0.5) * c.height / rows, 1, 1).data;
          return d[0] > 1.3 * d[2];"""
        for row, at, gap in ((0, 0.2, False), (0, 0.37, True), (0, 0.5, False), (1, 0.37, False), (2, 0.55, True),
                             (2, 0.37, False), (3, 0.04, True), (3, 0.5, False)):
            self.assertEqual(self.script(red, row, at), gap, (row, at))
        self.assertEqual(self.script("return document.documentElement.scrollWidth - innerWidth"), 0)
        self.keep("timeline")

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


    def test_has_loops_beams_and_sensors(self):
        self.assertEqual(self.script("return loopLines(viewer.scene).length"), len(tiny_run.LOOPS))
        self.assertEqual(self.script("return beamLines(viewer.scene, 0.25).length"), 4)
        self.assertEqual(self.script("return document.getElementById('sensor-names').children.length"), 4)
        self.assertTrue(self.script("return document.getElementById('live').hidden"))


class Phone(Case):
    SIZE = "phone"

    def test_the_timeline_shows_the_gaps_of_sensors(self):
        self.slide("time", 0.4)
        self.rest()
        self.keep("timeline")
        names, rows, bar = self.box("sensor-names"), self.box("sensor-rows"), self.box("timeline")
        self.assertGreaterEqual(names[0], bar[0])
        self.assertLessEqual(names[1], rows[0])
        self.assertAlmostEqual(names[3] - names[2], rows[3] - rows[2], delta=2)
        self.assertGreater(rows[1] - rows[0], 150)
        self.assertLessEqual(bar[3], 844)
        self.click("panel-toggle")
        self.choose("section-kinds", "vertical")
        self.script("document.getElementById('section-look').scrollIntoView()")
        self.keep("section")
        self.choose("section-kinds", "none")

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
        self.assertGreater(top, 550)
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


if __name__ == "__main__":
    page_client.run_tests(skip_reason())
