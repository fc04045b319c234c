#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The server of `apvi view`, without a browser: server_test.py APVI."""
import json
import pathlib
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import page_client
import tiny_run
from page_client import Page, get, request, status

ROOT = pathlib.Path(__file__).resolve().parents[2]
APVI = sys.argv.pop(1) if len(sys.argv) > 1 else str(ROOT / "build/cpu/bin/apvi")
TOKEN = "depths-of-the-sea"
MALFORMED = 10_000
MAX_GROWTH_KIB = 30_000  # of the server's memory, by allocators


class Case(unittest.TestCase):
    OPTIONS = []

    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.run_folder = cls.make_run()
        cls.server = page_client.Server(APVI, "view", cls.run_folder, "--port", 0, *cls.OPTIONS)
        cls.port = cls.server.port

    @classmethod
    def make_run(cls):
        return tiny_run.make(cls.folder / "dive")

    @classmethod
    def tearDownClass(cls):
        assert cls.server.stop() == 0, cls.server.log
        cls.temporary.cleanup()


class Watching(Case):
    def test_the_page_is_one_document(self):
        answer = get(self.port)
        self.assertEqual(status(answer), 200)
        self.assertIn(b"Content-Security-Policy: default-src 'none'", answer)
        self.assertIn(b"<canvas", answer)

    def test_the_scene_has_the_trajectory_with_its_states(self):
        scene = Page(self.port).scene
        self.assertEqual(scene["name"], "dive")
        self.assertEqual(scene["gaussians"], 4000)
        self.assertTrue(scene["medium"])
        self.assertEqual(len(scene["poses"]), 601)
        self.assertEqual(set(scene["states"]), set(tiny_run.STATES))
        self.assertEqual(len(scene["keyframes"]), 31)
        self.assertEqual(scene["up"], [0, 0, 1])

    def test_the_scene_has_loops_and_sensors(self):
        scene = Page(self.port).scene
        self.assertEqual(scene["loops"], [[1000 + a, 1000 + b] for a, b in tiny_run.LOOPS])
        self.assertEqual([s["name"] for s in scene["sensors"]], ["camera", "imu", "dvl", "pressure"])
        self.assertEqual(scene["sensors"][0]["spans"], [[1000, 1020], [1025, 1060]])

    def test_the_beams_come_from_the_recording(self):
        for _ in range(100):  # they are read while the page is served
            beams = Page(self.port).scene["beams"]
            if beams:
                break
            time.sleep(0.1)
        self.assertEqual(len(beams["stamps"]), 5 * tiny_run.SECONDS)
        self.assertEqual(beams["lengths"][0][:3], [tiny_run.RANGE_M] * 3)
        self.assertEqual((beams["valid"][0], beams["measured"][0]), (0b0111, 0b0111))
        self.assertEqual((beams["valid"][160], beams["measured"][160]), (0, 0))
        for direction in beams["directions"]:
            self.assertAlmostEqual(sum(x * x for x in direction), 1, places=3)
            # Without a range the length is that to a level bottom at the altitude.
            self.assertAlmostEqual(beams["lengths"][160][0] * direction[2], 2.5, places=2)

    def test_a_finished_run_ignores_what_only_a_run_can_do(self):
        page = Page(self.port)
        self.assertFalse(page.scene["can_save"])
        page.send(type="save")
        page.send(type="pause", paused=True)
        page.look()
        self.assertEqual(page.image()[0][0], 1)

    def test_a_snapshot_has_the_pixels_of_apvi_render(self):
        camera = self.folder / "camera.json"
        camera.write_text(json.dumps({
            "width": 320, "height": 240, "K": [[192, 0, 160], [0, 192, 120], [0, 0, 1]],
            "T_cam_world": [[1, 0, 0, -0.5], [0, -1, 0, 0], [0, 0, -1, 0.3], [0, 0, 0, 1]]}))
        subprocess.run([APVI, "-q", "render", self.run_folder, "--camera", camera, "--restore", "-o",
                        self.folder / "out"], check=True)
        page = Page(self.port)
        for layer, name in (("seen", "map.png"), ("restored", "map_restored.png")):
            page.look(3, (0.5, 0.0, 0.3), kind="snapshot", layer=layer)
            header, png = page.image()
            self.assertEqual(header[:7], (2, 0 if layer == "seen" else 1, 1, 3, 0, 320, 240))
            self.assertEqual(png, (self.folder / "out" / name).read_bytes(), layer)

    def test_no_water_is_the_restored_image(self):
        page = Page(self.port)
        images = []
        for layer, water in (("restored", 1.0), ("seen", 0.0), ("seen", 0.5), ("seen", 1.0)):
            page.look(1, kind="snapshot", layer=layer, water=water)
            images.append(page.image()[1])
        self.assertEqual(images[0], images[1])
        self.assertEqual(len(set(images)), 3)

    def test_a_distance_is_that_of_the_seabed(self):
        page = Page(self.port)
        page.look(9, kind="measure", column=160, row=120)
        answer = page.reply("point")
        self.assertEqual(answer["id"], 9)
        x, y, z = answer["point"]
        self.assertLess(abs(x) + abs(y), 0.03)
        self.assertAlmostEqual(z, tiny_run.height(x, y), delta=0.05)
        page.look(10, kind="measure", column=160, row=120, pose=[1.0, 0, 0, 0, 0, 0, 0])
        self.assertIsNone(page.reply("point")["point"])

    def test_only_the_section_is_drawn_and_measured(self):
        page = Page(self.port)
        level = {"normal": [0, 0, 1], "offset": -tiny_run.DEPTH_M, "thickness": 1.0}
        images = []
        for section in (None, level, {**level, "thickness": 0.1}, {**level, "offset": 5.0}):
            page.look(1, kind="snapshot", layer="alpha", section=section)
            images.append(page.image()[1])
        self.assertEqual(images[0], images[1])  # all of the seabed
        self.assertEqual(len(set(images)), 3)
        page.look(2, kind="measure", column=160, row=120, section=level)
        self.assertIsNotNone(page.reply("point")["point"])
        page.look(3, kind="measure", column=160, row=120, section={**level, "offset": 5.0})
        self.assertIsNone(page.reply("point")["point"])

    def test_every_layer_is_drawn(self):
        page = Page(self.port)
        images = set()
        for view, layer in enumerate(("seen", "restored", "depth", "alpha", "normals")):
            page.look(view, layer=layer)
            header, jpeg = page.image()
            self.assertEqual(header[4], view)
            self.assertTrue(jpeg.startswith(b"\xff\xd8"))
            images.add(jpeg)
            if layer == "depth":
                self.assertLess(abs(header[7] - 2.8), 0.2)
                self.assertLess(abs(header[8] - 3.2), 0.2)
        self.assertEqual(len(images), 5)

    def test_the_first_image_comes_within_a_second(self):
        def wait_s():
            began = time.monotonic()
            self.assertEqual(status(get(self.port)), 200)
            page = Page(self.port)
            page.look(width=640, height=480)
            page.image()
            return time.monotonic() - began
        self.assertLess(min(wait_s() for _ in range(5)), 1.0)  # the least: others may use this machine

    def test_ten_watchers_have_their_own_cameras(self):
        def watch(number):
            page = Page(self.port)
            for k in range(20):
                view = 100 * number + k
                page.look(view, (0.1 * number, 0.0, 0.01 * k), moving=True)
                header, _ = page.image()
                while header[4] != view:  # a sharper image of the view before
                    header, _ = page.image()
            done.append(number)

        done = []
        watchers = [threading.Thread(target=watch, args=(n,)) for n in range(10)]
        for thread in watchers:
            thread.start()
        for thread in watchers:
            thread.join()
        self.assertEqual(sorted(done), list(range(10)))


class Incomplete(Case):
    """Of an interrupted run whose recording is gone."""

    @classmethod
    def make_run(cls):
        run = tiny_run.make(cls.folder / "dive", 500)
        shutil.rmtree(run / "recording")
        (run / "sensors.csv").write_text("#sensor,begin [ns],end [ns],samples\ncamera,10")
        (run / "loops.csv").write_text("#from [ns],to [ns]\n1000\n")
        return run

    def test_the_map_is_shown_all_the_same(self):
        page = Page(self.port)
        self.assertEqual((page.scene["loops"], page.scene["sensors"], page.scene["beams"]), ([], [], None))
        page.look()
        self.assertEqual(page.image()[0][0], 1)


class ExportedPages(unittest.TestCase):
    def test_merge_neighbors_beyond_the_limit(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            run = tiny_run.make(folder / "dive", 4000)
            sizes = []
            for limit in (4000, 1500):
                page = folder / f"{limit}.html"
                done = subprocess.run([APVI, "view", run, "--export", page, "--max-gaussians", str(limit)],
                                      capture_output=True, text=True, check=True)
                self.assertEqual("merged into" in done.stderr, limit < 4000, done.stderr)
                sizes.append(page.stat().st_size)
            self.assertLess(sizes[1], sizes[0] - 100_000)


class BadArguments(unittest.TestCase):
    def test_are_refused(self):
        for arguments in (["/nowhere/map.ply"], [], ["x.ply", "--port", "99999"]):
            done = subprocess.run([APVI, "view", *arguments], capture_output=True, text=True)
            self.assertEqual(done.returncode, 2, done.stderr)
        with tempfile.TemporaryDirectory() as folder:
            run = tiny_run.make(pathlib.Path(folder) / "dive", 10)
            done = subprocess.run([APVI, "view", run, "--address", "seabed"], capture_output=True, text=True)
            self.assertEqual(done.returncode, 2, done.stderr)


class Strangers(Case):
    OPTIONS = ["--address", "0.0.0.0", "--token", TOKEN]

    def test_without_the_token_nothing_is_served(self):
        for target in ("/", "/socket", "/map.ply", "/?token=", "/?token=depths-of-the-seb"):
            self.assertEqual(status(get(self.port, target)), 401, target)
        self.assertEqual(Page(self.port).status, 401)

    def test_with_the_token_the_page_and_its_socket_are(self):
        self.assertIn(f"?token={TOKEN}", self.server.log)
        self.assertEqual(status(get(self.port, f"/?token={TOKEN}")), 200)
        page = Page(self.port, f"?token={TOKEN}")
        page.look()
        page.image()

    def test_no_file_is_served(self):
        for target in ("/map.ply", "/../map.ply", "/%2e%2e/resolved.yaml", "//etc/passwd", "/viewer.js"):
            self.assertEqual(status(get(self.port, f"{target}?token={TOKEN}")), 404, target)


class OtherOrigins(Case):
    def test_pages_of_other_origins_are_forbidden(self):
        self.assertEqual(Page(self.port, origin="http://evil.example").status, 403)
        self.assertEqual(Page(self.port, origin=f"http://127.0.0.1:{self.port}").status, 101)

    def test_foreign_names_are_forbidden(self):
        self.assertEqual(status(get(self.port, Host="evil.example")), 403)


class Malformed(Case):
    def setUp(self):
        self.random = random.Random(7)
        for _ in range(300):  # what allocators and the first images keep
            self.bad_request()
        self.ask_for_images(200)
        self.before = self.server.memory_kib()

    def tearDown(self):
        self.assertLess(self.server.memory_kib() - self.before, MAX_GROWTH_KIB)
        page = Page(self.port)
        page.look()
        self.assertEqual(page.image()[0][0], 1)

    def noise(self, longest):
        return self.random.randbytes(self.random.randrange(1, longest))

    def ask_for_images(self, count):
        """Asks for images faster than they are made and reads none."""
        page = Page(self.port)
        for k in range(count):
            page.look(k, width=640, height=480, kind="snapshot")
            page.look(k, moving=True)
        time.sleep(1.0)
        page.close()

    def bad_request(self):
        good = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: http://127.0.0.1\r\n\r\n"
        damaged = bytearray(good)
        damaged[self.random.randrange(len(good))] = self.random.randrange(256)
        data = self.random.choice([
            self.noise(2000), bytes(damaged), good[:self.random.randrange(len(good))], b"GET / HTTP/9.9\r\n\r\n",
            b"GET /" + b"a" * 20000 + b" HTTP/1.1\r\n\r\n", b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 3000 + b"\r\n",
            b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99999999999\r\n\r\n",
            b"GET /socket HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n\r\n"])
        return status(request(self.port, data))

    def bad_message(self):
        section = {"normal": self.random.choice([[0, 0, 1], [0, 0, 0], [1e200, 0, 0], "z", []]),
                   "offset": self.random.choice([0, 1e99, None]), "thickness": self.random.choice([1, 0, -1, "1"])}
        view = json.dumps({"type": "view", "section": self.random.choice([section, None, 3]), "id": 1,
                           "width": self.random.choice([0, -1, 1e99, 9999999, 32]), "height": 2, "focal": 1,
                           "pose": [1, 0, 0, 0, 0, 0, 0], "layer": "seen", "water": 1, "moving": True})
        return self.random.choice([
            page_client.frame(self.noise(200)), page_client.frame(self.noise(200), page_client.BINARY),
            page_client.frame(view.encode()), page_client.frame(b"[" * 5000), page_client.frame(b'{"type":"view"}'),
            page_client.frame(b"{}", first=0xF0), page_client.frame(b"{}", masked=False),
            page_client.frame(b"x" * 20000), page_client.frame(b"ab", opcode=self.random.randrange(3, 8)),
            page_client.frame(b"z" * 200, page_client.PING), struct.pack(">BBQ", 0x81, 0xFF, 1 << 62),
            self.noise(100)])

    def test_ten_thousand_requests_are_harmless(self):
        answers = {}
        for _ in range(MALFORMED):
            answer = self.bad_request()
            answers[answer] = answers.get(answer, 0) + 1
        self.assertLessEqual(set(answers), {0, 200, 400, 403, 404, 405, 431}, answers)
        self.assertGreater(answers[400], MALFORMED / 10)

    def test_ten_thousand_frames_are_harmless(self):
        page, connections = Page(self.port), 1
        for _ in range(MALFORMED):
            try:
                page.stream.sendall(self.bad_message())
                page.stream.sendall(page_client.frame(b"{}"))
            except OSError:
                page, connections = Page(self.port), connections + 1
        self.assertGreater(connections, 10)

    def test_requests_for_images_do_not_pile_up(self):
        self.ask_for_images(2000)

    def test_silent_connections_leave_room_for_a_watcher(self):
        silent = [page_client.connect(self.port) for _ in range(40)]
        page = Page(self.port)
        self.assertEqual(page.status, 101)
        for stream in silent:
            stream.close()


if __name__ == "__main__":
    page_client.run_tests(page_client.why_no_viewer(APVI))
