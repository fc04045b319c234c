# SPDX-License-Identifier: BSD-3-Clause
"""Python threads and callbacks while C++ works."""
import importlib.util
import threading
import time
import unittest

import support

if importlib.util.find_spec("numpy"):
    import numpy as np

    import apvi

LOCALIZATION = ["mapping.enabled=false", "run.threads=1"]

DESTROYED_EARLY = """
import sys, apvi
options = apvi.Options(set=["mapping.enabled=false", "run.mode=replay"])
recording = apvi.Recording(sys.argv[1], options)
system = apvi.System(options, recording.rig, on_pose=lambda stamp, pose: None)
for count, sample in zip(range(int(sys.argv[2])), recording):
    system.process(sample)
del system
print("ended")
"""


def localize(options, **callbacks):
    recording = apvi.Recording(support.dive(), options)
    system = apvi.System(options, recording.rig, **callbacks)
    for sample in recording:
        system.process(sample)
    system.finish()
    return system


class Callbacks(unittest.TestCase):
    def check_mode(self, mode):
        poses = {}
        options = apvi.Options(set=[*LOCALIZATION, f"run.mode={mode}"])
        system = localize(options, on_pose=lambda stamp, pose: poses.__setitem__(stamp, pose))
        trajectory = system.trajectory()
        self.assertGreater(len(trajectory), 80)
        np.testing.assert_array_equal(sorted(poses), trajectory.stamps)
        np.testing.assert_array_equal([poses[stamp] for stamp in sorted(poses)], trajectory.matrices)

    def test_poses_of_the_callers_thread_are_the_trajectory(self):
        self.check_mode("sequential")

    def test_poses_of_other_threads_are_the_trajectory(self):
        self.check_mode("replay")

    def test_exceptions_reach_the_caller(self):
        def fail(stamp, pose):
            raise ZeroDivisionError("of the callback")
        for mode in ("sequential", "replay"):
            with self.assertRaisesRegex(ZeroDivisionError, "of the callback"):
                localize(apvi.Options(set=[*LOCALIZATION, f"run.mode={mode}"]), on_pose=fail)

    def test_system_ends_while_its_threads_call_back(self):
        for count in (200, 2000):
            result = support.python(DESTROYED_EARLY, support.dive(), count, timeout=60)
            self.assertEqual((result.returncode, result.stdout), (0, "ended\n"), result.stderr)


class GlobalLock(unittest.TestCase):
    def test_other_threads_run_while_the_map_is_refined(self):
        system = localize(apvi.Options(set=[*support.OPTIONS, "mapping.final_iterations=150"]))
        ticks, ended = [], threading.Event()

        def tick():
            while not ended.wait(0.01):
                ticks.append((time.monotonic(), system.status().gaussians))
        ticker = threading.Thread(target=tick)
        ticker.start()
        begin = time.monotonic()
        system.refine()
        end = time.monotonic()
        ended.set()
        ticker.join()
        inside = [t for t, _ in ticks if begin < t < end]
        self.assertGreater(len(inside), 10 * (end - begin))
        self.assertGreater(ticks[-1][1], 0)


class Live(unittest.TestCase):
    def test_samples_of_threads_come_in_order_of_time(self):
        rig = apvi.Rig({"imu0": {"rate_hz": 200}, "pressure0": {}})
        live = apvi.LiveSequence(rig, reorder_s=10.0)

        def push(samples):
            for sample in samples:
                self.assertTrue(live.push(sample))
        imu = [apvi.ImuSample(k * 5_000_000, [0, 0, 0], [0, 0, 9.8]) for k in range(200)]
        pressure = [apvi.PressureSample(k * 50_000_000 + 1, 2e5) for k in range(20)]
        drivers = [threading.Thread(target=push, args=(samples,)) for samples in (imu, pressure)]
        for driver in drivers:
            driver.start()
        for driver in drivers:
            driver.join()
        live.finish()
        stamps = [sample.stamp for sample in live]
        self.assertEqual(stamps, sorted(sample.stamp for sample in imu + pressure))
        self.assertEqual(live.report["imu"], {"delivered": 200, "dropped": {}})

    def test_stop_ends_a_waiting_reader(self):
        live = apvi.LiveSequence(apvi.Rig({"imu0": {}}))
        threading.Timer(0.1, live.stop).start()
        self.assertEqual(list(live), [])
        self.assertFalse(live.push(apvi.ImuSample(1, [0, 0, 0], [0, 0, 9.8])))


class Mapping(unittest.TestCase):
    def test_images_with_known_poses_make_a_map(self):
        options = apvi.Options(set=support.OPTIONS)
        recording = apvi.Recording(support.dive(), options)
        reference, mapper = recording.reference(), apvi.Mapper(options, recording.rig)
        self.assertIsNone(mapper.map())
        images = (s for s in recording if isinstance(s, apvi.ImageFrame))
        for frame in list(images)[::10]:
            pose = reference.at(frame.stamp)
            if pose is not None:
                mapper.add(apvi.ImageFrame(frame.stamp, frame.image), pose)
        mapper.finish()
        self.assertGreater(len(mapper.map()), 1000)
        depths = mapper.map().means @ recording.rig.cameras[0].T_body_camera[:3, :3]
        self.assertTrue(np.isfinite(depths).all())


if __name__ == "__main__":
    support.main()
