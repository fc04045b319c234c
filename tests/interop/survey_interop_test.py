#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Opens products of surveys with the programs they are made for: survey_interop_test.py APVI.

The map is a plane of colored Gaussians. As in interop_test.py, tests are skipped if their package is
not installed or apvi was built without a library."""
import importlib.util
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

from interop_test import APVI, SKIPPED, Map, can, needs

if importlib.util.find_spec("numpy"):
    import numpy as np

EAST, NORTH, HEIGHT, SIDE, SPACING = 691234.567, 5331234.567, 2.0, 6.0, 0.01
PLACE = ["--epsg", 32632, "--origin", f"{EAST},{NORTH},{HEIGHT}", "--resolution", 0.01]


def write_plane(path):
    """Opaque flat Gaussians on z = 0.1 x - 7: red where x > 0, blue elsewhere."""
    line = (np.arange(round(SIDE / SPACING)) + 0.5) * SPACING - SIDE / 2
    x, y = (a.ravel() for a in np.meshgrid(line, line))
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
             "rot_0", "rot_1", "rot_2", "rot_3"]
    one = np.ones_like(x)
    dark, bright = -0.5 / 0.28209479, 0.5 / 0.28209479
    tilt = np.arctan(0.1)
    columns = [x, y, 0.1 * x - 7.0, np.where(x > 0, bright, dark), dark * one, np.where(x > 0, dark, bright),
               3.0 * one, np.log(0.7 * SPACING) * one, np.log(0.7 * SPACING) * one, np.log(1e-4) * one,
               np.cos(tilt / 2) * one, 0 * one, -np.sin(tilt / 2) * one, 0 * one]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(x)}",
              *(f"property float {name}" for name in names), "end_header", ""]
    path.write_bytes("\n".join(header).encode() + np.stack(columns, axis=1).astype("<f4").tobytes())
    return len(x)


class Product(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        if not can("export"):
            raise unittest.SkipTest("apvi was built without mapping")
        temporary = tempfile.TemporaryDirectory()
        cls.addClassCleanup(temporary.cleanup)
        cls.folder = pathlib.Path(temporary.name)
        cls.count = write_plane(cls.folder / "plane.ply")

    def export(self, word, *options):
        command = [APVI, "export", self.folder / "plane.ply", "--format", word, *options, "-o", self.folder / word]
        made = subprocess.run([str(a) for a in command], capture_output=True, text=True, check=False)
        if "this build has no" in made.stderr:
            self.skipTest(made.stderr.strip())
        self.assertEqual(made.returncode, 0, made.stderr)
        return self.folder / word


@needs("rasterio")
class Rasterio(Product):
    def test_elevation_model_has_heights_system_and_overviews(self):
        import rasterio
        with rasterio.open(self.export("elevation", *PLACE) / "elevation.tif") as file:
            self.assertEqual(file.crs.to_epsg(), 32632)
            self.assertEqual(file.nodata, -9999.0)
            self.assertTrue(file.overviews(1))
            self.assertEqual(file.profile["compress"], "deflate")
            self.assertTrue(file.profile["tiled"])
            heights = np.array([z[0] for z in file.sample([(EAST + dx, NORTH + 1.0) for dx in (-2, 0.005, 2)])])
        self.assertLess(np.abs(heights - (HEIGHT - 7.0 + 0.1 * np.array([-2, 0.005, 2]))).max(), 2e-3)

    def test_border_of_colors_is_where_it_is_on_the_ground(self):
        import rasterio
        with rasterio.open(self.export("orthomosaic", *PLACE) / "orthomosaic.tif") as file:
            red, _, _, alpha = file.read()
            row, column = file.index(EAST, NORTH)
        self.assertEqual(alpha[row, column], 255)
        self.assertLessEqual(abs(int(np.argmax(red[row] > 127)) - column), 1)

    def test_contours_and_hillshade_open(self):
        import rasterio
        folder = self.export("elevation", *PLACE, "--contour-interval", 0.2)
        with rasterio.open(folder / "hillshade.tif") as file:
            self.assertEqual(file.crs.to_epsg(), 32632)
        self.assertEqual((folder / "contours.gpkg").read_bytes()[:15], b"SQLite format 3")


@needs("laspy")
class Laspy(Product):
    def test_points_have_coordinates_colors_and_a_system(self):
        import laspy
        las = laspy.read(self.export("las", *PLACE) / "points.las")
        self.assertEqual((str(las.header.version), las.header.point_format.id), ("1.4", 7))
        self.assertEqual(len(las.points), self.count)
        self.assertLess(np.abs(las.z - (0.1 * (las.x - EAST) - 7.0 + HEIGHT)).max(), 2e-4)
        self.assertLess(abs(las.x.max() - (EAST + SIDE / 2 - SPACING / 2)), 1e-3)
        self.assertTrue((las.red[las.x > EAST] > 60000).all())
        self.assertTrue((las.red[las.x < EAST] == 0).all())
        self.assertIn("UTM zone 32N", las.vlrs.get("WktCoordinateSystemVlr")[0].string)


@needs("trimesh")
class Trimesh(Map):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        command = [APVI, "export", str(cls.run_folder), "--format", "mesh"]
        made = subprocess.run(command, capture_output=True, text=True, check=False)
        if "has no Open3D" in made.stderr:
            raise unittest.SkipTest(made.stderr.strip())
        made.check_returncode()

    def load(self, name):
        import trimesh
        return trimesh.load(self.run_folder / "mesh" / name, force="mesh", process=False)

    def test_ply_has_colors_and_lies_within_the_scene(self):
        import trimesh
        mesh = self.load("mesh.ply")
        truth = trimesh.load(self.dive / "truth/mesh.ply", process=False)
        self.assertGreater(len(mesh.faces), 1000)
        self.assertEqual(mesh.visual.kind, "vertex")
        inside = ((mesh.vertices > truth.bounds[0] - 1) & (mesh.vertices < truth.bounds[1] + 1)).all(axis=1)
        self.assertGreater(inside.mean(), 0.95)

    def test_glb_is_the_same_mesh_with_y_up(self):
        glb, ply = self.load("mesh.glb"), self.load("mesh.ply")
        turned = ply.vertices[:, [0, 2, 1]] * [1, 1, -1]
        self.assertEqual(len(glb.faces), len(ply.faces))
        self.assertLess(np.abs(np.sort(glb.vertices, axis=0) - np.sort(turned, axis=0)).max(), 1e-4)


@needs()
class Figures(Product):
    def test_areas_are_those_of_the_plane(self):
        report = json.loads((self.export("survey", "--resolution", 0.02) / "survey.json").read_text())
        self.assertLess(abs(report["area_m2"] / SIDE**2 - 1.0), 0.02)
        self.assertLess(abs(report["rugosity"] - np.hypot(1.0, 0.1)), 1e-3)


if __name__ == "__main__":
    ended = unittest.main(exit=False, verbosity=2)
    ran = ended.result.testsRun - len(ended.result.skipped)
    if ended.result.wasSuccessful() and ran <= 0:
        print("skipped: " + __doc__.split("\n\n")[1].strip())
        sys.exit(SKIPPED)
    sys.exit(0 if ended.result.wasSuccessful() else 1)
