#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The page of a run while it is made, without a browser: live_test.py APVI."""
import pathlib
import socket
import subprocess
import sys
import tempfile
import time
import unittest

import page_client
from page_client import Page

ROOT = pathlib.Path(__file__).resolve().parents[2]
APVI = sys.argv.pop(1) if len(sys.argv) > 1 else str(ROOT / "build/cpu/bin/apvi")
SIMULATION = ["duration_s=8", "rig.cam0.resolution=[160, 120]", "rig.cam0.intrinsics=[105, 105, 79.5, 59.5]",
              "rig.cam0.rate_hz=10"]
MAPPING = ["mapping.final_iterations=3000", "mapping.max_gaussians=4000", "mapping.initial_downscale=2",
           "vio.tracker.min_distance_px=8"]


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


def settings(values):
    return [argument for value in values for argument in ("--set", value)]


class Running(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self.temporary.name)
        subprocess.run([APVI, "-q", "sim", ROOT / "configs/scenes/seabed_easy.yaml", "-o", self.folder / "dive",
                        *settings(SIMULATION)], check=True)
        self.run_folder = self.folder / "run"
        self.server = page_client.Server(APVI, "run", self.folder / "dive", "-o", self.run_folder,
                                         f"--view={free_port()}", *settings(MAPPING))

    def tearDown(self):
        self.server.stop()
        self.temporary.cleanup()

    def wait_for(self, page, kind, seconds=300):
        end = time.monotonic() + seconds
        while (message := page.reply())["type"] != kind:
            self.assertLess(time.monotonic(), end, kind)
        return message

    def test_sensors_beams_and_a_saved_map(self):
        page = Page(self.server.port)
        pings = self.wait_for(page, "pings")
        self.assertEqual({len(pings[name]) for name in ("stamps", "lengths", "valid", "measured")},
                         {len(pings["stamps"])})
        self.assertTrue(all(0 < length < 10 for length in pings["lengths"][0]))
        while len(sensors := self.wait_for(page, "sensors")["sensors"]) < 4:
            pass
        self.assertEqual([s["name"] for s in sensors], ["camera", "imu", "dvl", "pressure"])
        self.wait_for(page, "poses")
        self.assertTrue(Page(self.server.port).scene["can_save"])
        self.save(page)
        self.assertIsNone(self.server.process.poll())  # it goes on
        later = Page(self.server.port).scene
        self.assertGreater(len(later["beams"]["stamps"]), 5)
        self.assertTrue(later["sensors"])

    def save(self, page):
        for _ in range(100):  # until there is a map
            page.send(type="save")
            error = self.wait_for(page, "saved")["error"]
            if not error:
                break
            self.assertEqual(error, "there is no map yet")
            time.sleep(0.5)
        self.assertGreater((self.run_folder / "map.ply").stat().st_size, 1000)
        self.assertTrue((self.run_folder / "checkpoint.pt").exists())


if __name__ == "__main__":
    page_client.run_tests(page_client.why_no_viewer(APVI))
