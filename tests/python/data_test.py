# SPDX-License-Identifier: BSD-3-Clause
"""Options, samples, poses and arrays across the boundary."""
import importlib.util
import pathlib
import unittest

import support

if importlib.util.find_spec("numpy"):
    import numpy as np

    import apvi


class Options(unittest.TestCase):
    def test_values_come_from_dict_then_overrides(self):
        options = apvi.Options({"run": {"threads": 3, "seed": 4}}, set=["run.seed=5"])
        self.assertEqual((options["run.threads"], options["run.seed"]), (3, 5))

    def test_file_inherits_a_configuration_of_the_package(self):
        path = support.scratch() / "mine.yaml"
        path.write_text("inherit: localization.yaml\nrun: {threads: 7}\n")
        options = apvi.Options(path)
        self.assertEqual((options["run.threads"], options["mapping.enabled"]), (7, False))

    def test_configurations_of_the_package_are_found_by_name(self):
        self.assertFalse(apvi.Options("localization.yaml")["mapping.enabled"])

    def test_every_value_survives_a_dict(self):
        options = apvi.Options(set=["mapping.initial_box_m=[0, 0, 0, 1, 1, 1]", "rig.cam0.rate_hz=4"])
        self.assertEqual(apvi.Options(options.to_dict()).to_yaml(), options.to_yaml())

    def test_assignment_is_checked(self):
        options = apvi.Options()
        options["mapping.initial_box_m"] = np.array([0, 0, 0, 1.5, 1, 1])
        self.assertEqual(options["mapping.initial_box_m"], [0, 0, 0, 1.5, 1, 1])
        with self.assertRaisesRegex(apvi.InputError, "outside"):
            options["run.threads"] = 0
        self.assertEqual(options["run.threads"], 2)

    def test_unknown_keys_are_errors(self):
        with self.assertRaisesRegex(apvi.InputError, "did you mean run.threads"):
            apvi.Options({"run": {"thread": 1}})
        with self.assertRaises(KeyError):
            apvi.Options()["run.thread"]

    def test_values_that_no_file_can_have_are_errors(self):
        with self.assertRaises(apvi.InputError):
            apvi.Options({"run": {"threads": object()}})


class Errors(unittest.TestCase):
    def test_input_errors_are_errors(self):
        self.assertTrue(issubclass(apvi.InputError, apvi.Error))
        self.assertTrue(issubclass(apvi.RunError, apvi.Error))
        with self.assertRaisesRegex(apvi.Error, "no such"):
            apvi.Recording("/no/such/folder")

    def test_unwritable_files_are_run_errors(self):
        with self.assertRaises(apvi.RunError):
            apvi.Trajectory([1], [[0, 0, 0]], [[0, 0, 0, 1]]).write_tum("/no/such/folder/x.tum")


class Samples(unittest.TestCase):
    def test_numbers_are_kept(self):
        imu = apvi.ImuSample(10**18 + 1, [1, 2, 3], (4.0, 5.0, 6.5))
        self.assertEqual(imu.stamp, 10**18 + 1)
        np.testing.assert_array_equal(imu.accel, [4, 5, 6.5])
        beams = [apvi.DvlBeam(0.1, 2.0), None]
        dvl = apvi.DvlSample(5, np.ones(3), valid=False, altitude=2.5, beams=beams)
        self.assertEqual((dvl.valid, dvl.altitude, dvl.figure_of_merit), (False, 2.5, None))
        self.assertEqual([beam.range if beam else None for beam in dvl.beams], [2.0, None, None, None])

    def test_images_are_rgb_or_gray(self):
        color = np.random.default_rng(1).integers(0, 256, (5, 7, 3), dtype=np.uint8)
        np.testing.assert_array_equal(apvi.ImageFrame(1, color).image, color)
        view = color[::-1, ::2, 0]  # not contiguous
        np.testing.assert_array_equal(apvi.ImageFrame(1, view).image, view)

    def test_images_are_copied(self):
        pixels = np.zeros((4, 4), np.uint8)
        frame = apvi.ImageFrame(1, pixels)
        pixels[:] = 9
        self.assertEqual(frame.image.max(), 0)

    def test_wrong_shapes_and_types_are_errors(self):
        with self.assertRaisesRegex(apvi.InputError, "gyro"):
            apvi.ImuSample(1, [1, 2], [1, 2, 3])
        with self.assertRaisesRegex(apvi.InputError, "uint8"):
            apvi.ImageFrame(1, np.zeros((4, 4, 4), np.uint8))
        with self.assertRaises(TypeError):
            apvi.ImageFrame(1, np.zeros((4, 4), np.float32))


class Poses(unittest.TestCase):
    STAMPS = [10, 20]
    POSITIONS = [[0, 0, 0], [2, 0, 0]]
    QUATERNIONS = [[0, 0, 0, 1], [0, 0, 2**-0.5, 2**-0.5]]  # yaw of 0 and 90 degrees

    def test_quaternions_and_matrices_agree(self):
        trajectory = apvi.Trajectory(self.STAMPS, self.POSITIONS, self.QUATERNIONS)
        expected = [[0, -1, 0, 2], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        np.testing.assert_allclose(trajectory.matrices[1], expected, atol=1e-15)
        np.testing.assert_allclose(trajectory.tum[1], [20e-9, 2, 0, 0, *self.QUATERNIONS[1]])

    def test_poses_are_interpolated(self):
        trajectory = apvi.Trajectory(self.STAMPS, self.POSITIONS, self.QUATERNIONS)
        middle = trajectory.at(15)
        np.testing.assert_allclose(middle[:3, 3], [1, 0, 0])
        np.testing.assert_allclose(middle[0, :2], [2**-0.5, -(2**-0.5)])
        self.assertIsNone(trajectory.at(21))

    def test_files_are_read_as_written(self):
        path = support.scratch() / "poses.tum"
        apvi.Trajectory(self.STAMPS, self.POSITIONS, self.QUATERNIONS).write_tum(path)
        np.testing.assert_array_equal(apvi.Trajectory.read(path).stamps, self.STAMPS)

    def test_decreasing_stamps_and_bad_quaternions_are_errors(self):
        with self.assertRaisesRegex(apvi.InputError, "increase"):
            apvi.Trajectory([2, 1], self.POSITIONS)
        with self.assertRaisesRegex(apvi.InputError, "unit norm"):
            apvi.Trajectory([1, 2], self.POSITIONS, [[0, 0, 0, 1], [0, 0, 0, 3]])


class Rigs(unittest.TestCase):
    CAMERA = {"intrinsics": [100, 110, 31.5, 23.5], "resolution": [64, 48], "distortion": "radtan",
              "coefficients": [-0.1, 0.03, 0, 0], "T_body_sensor": np.eye(4).ravel()}

    def test_rig_has_the_values_of_the_dict(self):
        rig = apvi.Rig({"world": "ned", "imu0": {"rate_hz": 100}, "cam0": self.CAMERA})
        self.assertEqual((rig.world, rig.sensors), ("ned", ["camera", "imu"]))
        camera = rig.cameras[0].camera
        self.assertEqual((camera.fx, camera.fy, camera.width, camera.distortion), (100, 110, 64, "radtan"))
        self.assertIsNone(rig.T_body_dvl)

    def test_pinhole_projects_by_the_formula(self):
        camera = apvi.Rig({"imu0": {}, "cam0": self.CAMERA}).cameras[0].camera.pinhole()
        np.testing.assert_allclose(camera.project([[0.1, 0.2, 2.0]]), [[36.5, 34.5]])
        ray = camera.unproject([[36.5, 34.5]])[0]
        np.testing.assert_allclose(ray / ray[2], [0.05, 0.1, 1.0])
        self.assertTrue(np.isnan(camera.project([[0, 0, -1]])).all())

    def test_bad_calibrations_are_errors(self):
        with self.assertRaisesRegex(apvi.InputError, "resolution"):
            apvi.Rig({"cam0": {"resolution": 3}})
        with self.assertRaisesRegex(apvi.InputError, "distortion"):
            apvi.Camera(1, 1, 0, 0, 4, 4, "fisheye")


class Doctor(unittest.TestCase):
    def test_simulated_dive_has_no_errors(self):
        report = apvi.examine(support.dive())
        self.assertEqual(report.errors, 0)
        sensors = {finding.sensor for finding in report.findings}
        self.assertTrue({"imu0", "dvl0", "cam0"} <= sensors, sensors)
        self.assertIn("imu0", str(report))


class NumpyVersions(unittest.TestCase):
    def test_numpy_2_needs_a_pybind11_that_knows_it(self):
        from apvi import _numpy
        self.assertIsNone(_numpy.conflict("1.26.4", "2.10.3"))
        self.assertIsNone(_numpy.conflict("2.4.6", "3.1.0"))
        self.assertIsNone(_numpy.conflict("2.0.0rc1", "2.12.0"))
        self.assertIn("numpy<2", _numpy.conflict("2.0.0", "2.10.3"))


class Typing(unittest.TestCase):
    def test_package_is_marked_as_typed(self):
        folder = pathlib.Path(apvi.__file__).parent
        self.assertTrue((folder / "py.typed").exists())
        self.assertTrue((folder / "_apvi.pyi").exists())


if __name__ == "__main__":
    support.main()
