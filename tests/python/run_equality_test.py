# SPDX-License-Identifier: BSD-3-Clause
"""The package and the program give the same bits."""
import functools
import unittest

import support

if support.importlib.util.find_spec("numpy"):
    import numpy as np

    import apvi


@functools.cache
def run():
    """Run folder of the program."""
    folder = support.scratch() / "run"
    support.program("run", support.dive(), "-o", folder, "--no-report", *support.settings(support.OPTIONS))
    return folder


@functools.cache
def system():
    """The same through the package, in the ten lines of docs/python.md."""
    options = apvi.Options(set=support.OPTIONS)
    recording = apvi.Recording(support.dive(), options)
    made = apvi.System(options, recording.rig)
    for sample in recording:
        made.process(sample)
    made.finish()
    made.refine()
    return made


class RunEquality(unittest.TestCase):
    def assert_same_bytes(self, name, write):
        path = support.scratch() / f"written_{name}"
        write(path)
        self.assertGreater(path.stat().st_size, 1000)
        self.assertEqual((run() / name).read_bytes(), path.read_bytes())

    def test_trajectory_is_that_of_the_program(self):
        self.assert_same_bytes("trajectory.tum", system().trajectory().write_tum)

    def test_map_is_that_of_the_program(self):
        self.assert_same_bytes("map.ply", system().map().save)

    def test_keyframes_are_those_of_the_program(self):
        self.assert_same_bytes("keyframes.tum", system().map().keyframes.write_tum)

    def test_stored_map_has_the_arrays_of_the_snapshot(self):
        stored, made = apvi.MapSnapshot.read(run()), system().map()
        self.assertEqual(len(stored), len(made))
        for name in ("means", "log_scales", "quaternions", "logit_opacities"):
            np.testing.assert_array_equal(getattr(stored, name), getattr(made, name))
        np.testing.assert_allclose(stored.spherical_harmonics, made.spherical_harmonics, atol=2e-6)
        np.testing.assert_allclose(stored.medium.beta_d, made.medium.beta_d, rtol=1e-6)

    def test_snapshot_renders_as_the_map_does(self):
        calibration = apvi.Recording(support.dive()).rig.cameras[0]
        view = calibration.camera.pinhole(), system().pose()[1] @ calibration.T_body_camera
        live, copy = system().render(*view), system().map().render(*view)
        self.assertEqual(live.color.shape, (240, 320, 3))
        self.assertGreater(live.alpha.mean(), 0.5)
        for name in ("color", "restored", "depth", "alpha"):
            np.testing.assert_array_equal(getattr(live, name), getattr(copy, name))

    def test_metrics_are_those_of_the_program(self):
        recording = apvi.Recording(support.dive())
        metrics = apvi.evaluate(recording.reference(), system().trajectory(), world=recording.rig.world)
        stored = support.json.loads((run() / "metrics.json").read_text())["trajectory"]
        self.assertEqual(metrics, {key: stored[key] for key in metrics})
        self.assertLess(metrics["ate_rmse_m"], 0.05)


if __name__ == "__main__":
    support.main()
