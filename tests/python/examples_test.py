# SPDX-License-Identifier: BSD-3-Clause
"""The programs in examples/python do what they say."""
import re
import subprocess
import sys
import unittest

import support

EXAMPLES = support.ROOT / "examples" / "python"


def example(name, *arguments):
    result = subprocess.run([sys.executable, str(EXAMPLES / name), *map(str, arguments)], capture_output=True,
                            text=True, check=False, timeout=600)
    if result.returncode != 0:
        raise AssertionError(result.stderr)
    return result.stdout


def pixels(path):
    data = path.read_bytes()
    return data[data.index(b"255\n") + 4:]


class Examples(unittest.TestCase):
    def test_map_of_a_dive_is_made_and_rendered(self):
        run = support.scratch() / "example"
        output = example("01_localize_and_map.py", support.dive(), run)
        self.assertLess(float(re.search(r"ATE ([\d.]+) m", output).group(1)), 0.05)
        self.assertGreater(int(re.search(r"(\d+) Gaussians", output).group(1)), 1000)
        (run / "keyframes.tum").write_bytes((run / "trajectory.tum").read_bytes())
        output = example("02_render_map.py", run, support.dive() / "rig.yaml", run)
        self.assertGreater(int(re.match(r"(\d+)%", output).group(1)), 50)
        color, restored = pixels(run / "color.ppm"), pixels(run / "restored.ppm")
        self.assertEqual(len(color), 320 * 240 * 3)
        self.assertNotEqual(color, restored)

    def test_samples_of_own_sensors_are_integrated(self):
        ahead = float(re.match(r"([\d.]+) m ahead", example("03_own_sensors.py")).group(1))
        self.assertAlmostEqual(ahead, 10.0, delta=0.5)


if __name__ == "__main__":
    support.main()
