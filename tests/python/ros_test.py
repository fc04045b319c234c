# SPDX-License-Identifier: BSD-3-Clause
"""Messages of ROS 2 become samples, and results become what messages take; without ROS."""
import importlib.util
import sys
import unittest

import cdr
import support

sys.path.insert(0, str(support.ROOT / "ros2" / "apvi_ros"))

if importlib.util.find_spec("numpy"):
    import numpy as np
    from apvi_ros import arrays, parameters
    from apvi_ros.estimator import Estimator

    import apvi

STAMP = 1_700_000_000_123_456_789


def decode(sensor, type_name, message):
    return apvi.RosDecoder(sensor, type_name).decode(message)


class Decoder(unittest.TestCase):
    def test_imu(self):
        sample = decode("imu", "sensor_msgs/msg/Imu", cdr.imu(STAMP, [1, 2, 3], [4, 5, 6]))
        self.assertEqual(sample.stamp, STAMP)
        np.testing.assert_array_equal([sample.gyro, sample.accel], [[1, 2, 3], [4, 5, 6]])

    def test_pressure(self):
        message = cdr.pressure(STAMP, 151987.5)
        self.assertEqual(decode("pressure", "sensor_msgs/msg/FluidPressure", message).pressure_pa, 151987.5)

    def test_twist_is_a_velocity_over_ground(self):
        message = cdr.twist(STAMP, [0.5, -0.1, 0.02])
        sample = decode("dvl", "geometry_msgs/msg/TwistWithCovarianceStamped", message)
        self.assertTrue(sample.valid)
        np.testing.assert_array_equal(sample.velocity, [0.5, -0.1, 0.02])

    def test_images_are_rgb(self):
        pixels = np.random.default_rng(2).integers(0, 256, (6, 9, 3), dtype=np.uint8)
        for encoding, given in (("rgb8", pixels), ("bgr8", pixels[..., ::-1])):
            frame = decode("cam1", "sensor_msgs/msg/Image", cdr.image(STAMP, np.ascontiguousarray(given), encoding))
            self.assertEqual(frame.camera, 1)
            np.testing.assert_array_equal(frame.image, pixels)

    def test_message_without_a_stamp_has_that_of_its_arrival(self):
        decoder = apvi.RosDecoder("imu", "sensor_msgs/msg/Imu")
        self.assertEqual(decoder.decode(cdr.imu(0, [0, 0, 0], [0, 0, 9.8]), received=77).stamp, 77)

    def test_damaged_messages_are_none(self):
        message = cdr.imu(STAMP, [1, 2, 3], [4, 5, 6])
        decoder = apvi.RosDecoder("imu", "sensor_msgs/msg/Imu")
        for size in range(len(message)):
            self.assertIsNone(decoder.decode(message[:size]))

    def test_definition_of_another_type_is_given(self):
        definition = "std_msgs/Header header\nfloat64 fluid_pressure\n" + 80 * "=" + \
            "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" + 80 * "=" + \
            "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
        decoder = apvi.RosDecoder("pressure", "mine/msg/Barometer", definition)
        self.assertEqual(decoder.decode(cdr.Cdr().header(STAMP).put("d", 2e5).message()).pressure_pa, 2e5)
        with self.assertRaisesRegex(apvi.InputError, "definition"):
            apvi.RosDecoder("pressure", "mine/msg/Barometer")


class Arrays(unittest.TestCase):
    def test_quaternion_is_that_of_the_rotation(self):
        random = np.random.default_rng(3)
        for _ in range(200):
            q = random.normal(size=4) * random.choice([1e-9, 1.0], 4)
            q /= np.linalg.norm(q)
            T = apvi.Trajectory([1], [[0, 0, 0]], [q]).matrices[0]
            np.testing.assert_allclose(arrays.quaternion_of(T), q if q[3] >= 0 else -q, atol=1e-7)

    def test_depth_is_in_meters_and_color_in_bytes(self):
        class Images:
            color = np.array([[[0.0, 0.5, 2.0]]], np.float32)
            depth = np.array([[1.5]], np.float32)
        self.assertEqual(arrays.pixels_of(Images, "depth")[0], "32FC1")
        encoding, pixels = arrays.pixels_of(Images, "color")
        self.assertEqual((encoding, pixels.tolist()), ("rgb8", [[[0, 128, 255]]]))


class Parameters(unittest.TestCase):
    def test_configuration_keys_are_options(self):
        given = {**parameters.DEFAULTS, "run.threads": 3, "mapping.initial_box_m": np.arange(6.0)}
        options = parameters.options_of(given)
        self.assertEqual((options["run.mode"], options["run.threads"]), ("realtime", 3))
        self.assertEqual(options["mapping.initial_box_m"], [0, 1, 2, 3, 4, 5])

    def test_misspelled_parameters_are_found(self):
        self.assertEqual(parameters.unknown({**parameters.DEFAULTS, "use_sim_time": True, "run.seed": 1}), [])
        self.assertEqual(parameters.unknown({"rig_fille": ""}), ["rig_fille"])
        with self.assertRaises(apvi.InputError):
            parameters.options_of({"run.thread": 3})


class Threads(unittest.TestCase):
    OPTIONS = ["mapping.enabled=false", "run.threads=1"]

    def test_reset_begins_anew(self):
        options = apvi.Options(set=self.OPTIONS)
        samples = list(apvi.Recording(support.dive(), options))
        poses = []
        estimator = Estimator(options, apvi.Recording(support.dive()).rig, lambda stamp, T: poses.append(stamp))
        for sample in samples[: len(samples) // 2]:
            estimator.push(sample)
        estimator.reset()
        self.assertEqual(estimator.system.status().poses, 0)
        poses.clear()
        for sample in samples:
            self.assertTrue(estimator.push(sample))
        estimator.finish()
        self.assertEqual(estimator.error, "")
        self.assertGreater(len(poses), 80)
        self.assertEqual(estimator.report["imu"]["delivered"], sum(isinstance(s, apvi.ImuSample) for s in samples))
        self.assertFalse(estimator.push(samples[-1]))

    def test_failure_is_kept_for_the_diagnostics(self):
        def fail(stamp, T):
            raise ValueError("of the callback")
        options = apvi.Options(set=self.OPTIONS)
        estimator = Estimator(options, apvi.Recording(support.dive()).rig, fail)
        for sample in apvi.Recording(support.dive(), options):
            estimator.push(sample)
        estimator.finish()
        self.assertIn("of the callback", estimator.error)


if __name__ == "__main__":
    support.main()
