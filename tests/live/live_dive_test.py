#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""`apvi live` with a simulated vehicle on the loopback: live_dive_test.py APVI."""
import json
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import unittest

from vehicle import free_port, shift_stamps

ROOT = pathlib.Path(__file__).resolve().parents[2]
APVI = sys.argv.pop(1) if len(sys.argv) > 1 else str(ROOT / "build/cpu/bin/apvi")
DURATION_S = 45
NO_MAP = ["--no-report", "--set", "mapping.enabled=false"]


def apvi(*arguments):
    result = subprocess.run([APVI, *map(str, arguments)], capture_output=True, text=True)
    if result.returncode != 0:
        raise AssertionError(result.stderr)
    return result.stdout


def ate(run):
    return json.loads((run / "metrics.json").read_text())["trajectory"]["ate_rmse_m"]


class LiveDive(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.dive, cls.live = cls.folder / "dive", cls.folder / "live"
        apvi("sim", ROOT / "configs/scenes/seabed_easy.yaml", "-o", cls.dive, "--no-images",
             "--set", f"duration_s={DURATION_S}")
        cls.play()

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    @classmethod
    def play(cls):
        dvl, autopilot = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
        vehicle = subprocess.Popen(
            [sys.executable, ROOT / "tests/live/vehicle.py", cls.dive, "--dvl-port", str(dvl),
             "--mavlink-port", str(autopilot)], stdout=subprocess.PIPE, text=True)
        vehicle.stdout.readline()  # it waits
        live = subprocess.Popen(
            [APVI, "live", f"waterlinked://127.0.0.1:{dvl}", f"mavlink://udp:{autopilot}",
             "--rig", cls.dive / "rig.yaml", "-o", cls.live, *NO_MAP],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        first_ns, sent_ns = map(int, vehicle.stdout.readline().split())
        cls.shift_ns = first_ns - sent_ns
        vehicle.wait(timeout=20 * DURATION_S)
        live.send_signal(signal.SIGINT)
        _, cls.log = live.communicate(timeout=600)
        cls.status = live.returncode
        vehicle.stdout.close()

    def test_ctrl_c_ends_the_run_with_all_results(self):
        self.assertEqual(self.status, 0, self.log)
        metrics = json.loads((self.live / "metrics.json").read_text())
        self.assertTrue(metrics["live"]["recording"]["complete"])
        self.assertGreater(metrics["live"]["latency"]["poses"], 100)

    def test_the_recording_gives_the_same_poses(self):
        again = self.folder / "again"
        apvi("run", self.live / "recording", "-o", again, *NO_MAP)
        live = (self.live / "trajectory.tum").read_text().splitlines()
        self.assertGreater(len(live), 100)
        # What came in the last moments may have been recorded only.
        self.assertEqual((again / "trajectory.tum").read_text().splitlines()[:len(live)], live)

    def test_poses_are_as_good_as_those_of_the_dive_offline(self):
        offline = self.folder / "offline"
        apvi("run", self.dive, "-o", offline, *NO_MAP)
        reference = self.dive / "mav0/state_groundtruth_estimate0/data.csv"
        shifted = self.folder / "shifted.tum"
        shift_stamps(self.live / "trajectory.tum", self.shift_ns, shifted)
        figures = json.loads(apvi("eval", "trajectory", "--reference", reference, "--estimate",
                                  shifted, "--json"))
        self.assertLess(figures["trajectory"]["ate_rmse_m"], 1.2 * ate(offline) + 0.005)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], "-v"])
