#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Compares the mesh and the elevation model of a run with the truth of a simulated dive.

    apvi export RUN --format mesh && apvi export RUN --format elevation
    benchmarks/surface.py DIVE RUN [--mesh FILE] [--elevation FILE] [--distance 0.02] [--views 3]

The run's frame is moved to that of the truth by its smoothed trajectory (rotation and translation).
Truth counts where at least --views true depth images show it nearer than twice their median depth.
Precision is the share of the mesh's surface within --distance of the truth, recall the share of the
truth that counts within --distance of the mesh, F-score their harmonic mean (Knapitsch et al., "Tanks
and Temples", 2017). Errors of the elevation model are those against the highest true surface.
Requires numpy, scipy and yaml, for the elevation model also rasterio (from the Python index).
"""
import argparse
import pathlib

import numpy as np
import yaml
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

SAMPLES = 400_000
MARGIN_m = 12.0  # around the path, in which truth is looked for: farther than meshes reach
NEAR = 6  # samples of a surface that are candidates for its nearest triangle
FIELD = 1.3  # tangent of the angle up to which a lens shows something, by that of a pinhole
DEPTH_TOLERANCE = 0.02  # relative, of a point that a depth image shows
HIDDEN = 0.003  # relative, by which a point is behind what a depth image shows, as the inside of a plate is


def read_tum(path):
    rows = np.loadtxt(path, comments="#", ndmin=2)
    return rows[:, 0], rows[:, 1:4], Rotation.from_quat(rows[:, 4:8])


PLY_TYPES = {"char": "i1", "uchar": "u1", "short": "<i2", "ushort": "<u2", "int": "<i4", "uint": "<u4",
             "float": "<f4", "double": "<f8"}


def to_segment(p, a, b):
    """Distance of each point [n,3] to a line segment."""
    along = ((p - a) * (b - a)).sum(1) / np.maximum(((b - a) ** 2).sum(1), 1e-30)
    return np.linalg.norm(p - a - np.clip(along, 0, 1)[:, None] * (b - a), axis=1)


def to_triangle(p, corners):
    """Distance of each point [n,3] to a triangle [n,3,3]: to its plane above it, to its sides beside it."""
    a, b, c = corners.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    sides = ((a, b), (b, c), (c, a))
    above = np.all([(np.cross(t - s, p - s) * normal).sum(1) > 0 for s, t in sides], 0)
    return np.where(above, np.abs(((p - a) * normal).sum(1)), np.min([to_segment(p, s, t) for s, t in sides], 0))


class Mesh:
    """Triangles of a binary little-endian PLY file."""

    def __init__(self, path):
        with open(path, "rb") as file:
            elements = []
            for line in iter(file.readline, b"end_header\n"):
                words = line.decode().split()
                if words[0] == "element":
                    elements.append((words[1], int(words[2]), []))
                elif words[0] == "property" and words[1] == "list":
                    elements[-1][2].extend([("n", PLY_TYPES[words[2]]), ("i", PLY_TYPES[words[3]], 3)])
                elif words[0] == "property":
                    elements[-1][2].append((words[2], PLY_TYPES[words[1]]))
            data = {name: np.fromfile(file, np.dtype(row), count) for name, count, row in elements}
        self.vertices = np.stack([data["vertex"][axis] for axis in "xyz"], 1).astype(float)
        self.triangles = data["face"]["i"]
        assert (data["face"]["n"] == 3).all(), path

    def cropped(self, low, high):
        """Without triangles that have no corner in a box."""
        inside = ((self.vertices >= low) & (self.vertices <= high)).all(1)
        self.triangles = self.triangles[inside[self.triangles].any(1)]
        return self

    def areas(self):
        a, b, c = (self.vertices[self.triangles[:, i]] for i in range(3))
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)

    def sampled(self, count):
        """Points that are evenly spread over the area."""
        return self.samples(count)[0]

    def samples(self, count):
        """Such points and the triangle of each."""
        random = np.random.default_rng(1)
        areas = self.areas()
        which = random.choice(len(areas), count, p=areas / areas.sum())
        u, v = random.random((2, count, 1))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        a, b, c = (self.vertices[self.triangles[which, i]] for i in range(3))
        return a + u * (b - a) + v * (c - a), which

    def distances(self, points):
        """From each point to the surface: to the nearest of the triangles that the samples near it are from."""
        corners = self.vertices[self.triangles]
        samples, which = self.samples(4 * SAMPLES)
        samples = np.concatenate([samples, corners.mean(1)])  # no triangle is without one
        which = np.concatenate([which, np.arange(len(corners))])
        near = which[cKDTree(samples).query(points, k=NEAR, workers=-1)[1]]
        return np.min([to_triangle(points, corners[near[:, i]]) for i in range(NEAR)], 0)


def read_pfm(path):
    with open(path, "rb") as file:
        assert file.readline().strip() == b"Pf", path
        width, height = map(int, file.readline().split())
        order = "<f4" if float(file.readline()) < 0 else ">f4"
        return np.frombuffer(file.read(), order).reshape(height, width)[::-1]


def alignment(dive, run):
    """R, t with truth = R run + t, least squares over the positions (Umeyama, 1991)."""
    path = run / "trajectory_smoothed.tum"
    stamps, positions, _ = read_tum(path if path.exists() else run / "keyframes.tum")
    true_stamps, true_positions, _ = read_tum(dive / "truth/trajectory.tum")
    nearest = np.clip(np.searchsorted(true_stamps, stamps), 1, len(true_stamps) - 1)
    nearest -= stamps - true_stamps[nearest - 1] < true_stamps[nearest] - stamps
    truth = true_positions[nearest]
    a, b = positions - positions.mean(0), truth - truth.mean(0)
    u, _, vt = np.linalg.svd(b.T @ a)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    error = b - a @ rotation.T
    print(f"trajectory: RMSE {np.sqrt((error ** 2).sum(1).mean()) * 1000:.1f} mm after alignment")
    return rotation, truth.mean(0) - rotation @ positions.mean(0)


def distorted(x, y, camera):
    """Where the lens shows what a pinhole shows at x, y; NaN far outside of the image."""
    if camera.get("distortion", "none") == "none":
        return x, y
    assert camera["distortion"] == "radtan", camera["distortion"]
    k1, k2, p1, p2 = camera["coefficients"][:4]
    fx, fy, cx, cy = camera["intrinsics"]
    far = (np.abs(x) > FIELD * max(cx, camera["resolution"][0] - cx) / fx) | (
        np.abs(y) > FIELD * max(cy, camera["resolution"][1] - cy) / fy)
    x, y = np.where(far, np.nan, x), np.where(far, np.nan, y)
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2 * r2
    return (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)


def seen_by(dive, points):
    """Number of true depth images that show each point nearer than twice their median depth."""
    camera = yaml.safe_load((dive / "rig.yaml").read_text())["cam0"]
    fx, fy, cx, cy = camera["intrinsics"]
    mount = np.array(camera["T_body_sensor"], float).reshape(4, 4)
    stamps, positions, rotations = read_tum(dive / "truth/trajectory.tum")
    count = np.zeros(len(points), int)
    for file in sorted((dive / "truth/depth").glob("*.pfm")):
        depth = read_pfm(file)
        i = np.argmin(np.abs(stamps - int(file.stem) * 1e-9))
        R = rotations[i].as_matrix() @ mount[:3, :3]
        p = (points - positions[i] - rotations[i].as_matrix() @ mount[:3, 3]) @ R
        z = np.where(p[:, 2] > 0.05, p[:, 2], np.inf)
        x, y = distorted(p[:, 0] / z, p[:, 1] / z, camera)
        u, v = (np.nan_to_num(np.rint(w), nan=-1).astype(int) for w in (fx * x + cx, fy * y + cy))
        inside = np.isfinite(z) & (u >= 0) & (v >= 0) & (u < depth.shape[1]) & (v < depth.shape[0])
        at = np.where(inside, v, 0), np.where(inside, u, 0)
        # Between neighboring pixels a slanted surface may be anywhere between their depths.
        lowest = minimum_filter(np.where(depth > 0, depth, np.inf), 3)[at]
        highest = maximum_filter(depth, 3)[at]
        shown = (z > (1 - HIDDEN) * lowest) & (z < (1 + HIDDEN) * highest)
        near = z < 2 * np.median(depth[depth > 0]) if (depth > 0).any() else False
        count += inside & near & shown & (np.abs(depth[at] - z) < DEPTH_TOLERANCE * z)
    return count


def compare_mesh(file, truth, dive, moved, distance, views):
    mesh = Mesh(file)
    found = moved(mesh.sampled(SAMPLES))
    true_points = truth.sampled(SAMPLES)
    counted = true_points[seen_by(dive, true_points) >= views]
    to_truth = truth.distances(found)
    mesh.vertices = moved(mesh.vertices)
    to_mesh = mesh.distances(counted)
    print(f"mesh: {len(mesh.vertices)} vertices, {mesh.areas().sum():.1f} m2; truth {len(counted)} points, "
          f"{truth.areas().sum() * len(counted) / len(true_points):.1f} m2")
    for limit in (0.5 * distance, distance, 2 * distance, 5 * distance):
        precision, recall = np.mean(to_truth < limit), np.mean(to_mesh < limit)
        print(f"  within {1000 * limit:.0f} mm: precision {precision:.3f}, recall {recall:.3f}, "
              f"F-score {2 * precision * recall / max(1e-9, precision + recall):.3f}")
    print(f"  mesh to truth: median {1000 * np.median(to_truth):.1f} mm, "
          f"90 % within {1000 * np.quantile(to_truth, 0.9):.1f} mm")


def compare_elevation(file, truth, rotation, offset):
    import rasterio

    with rasterio.open(file) as raster:
        heights = raster.read(1)
        rows, columns = np.nonzero(heights != raster.nodata)
        east, north = rasterio.transform.xy(raster.transform, rows, columns)
        pixel = raster.res[0]
    points = np.stack([east, north, heights[rows, columns]], 1) @ rotation.T + offset
    dense = truth.sampled(20 * SAMPLES)
    low = np.floor(points[:, :2].min(0) / pixel) - 1
    shape = np.ceil(points[:, :2].max(0) / pixel - low).astype(int) + 2
    index = np.floor(dense[:, :2] / pixel - low).astype(int)
    near = ((index >= 0) & (index < shape)).all(1)
    highest = np.full(shape, -np.inf)
    np.maximum.at(highest, tuple(index[near].T), dense[near, 2])
    at = np.floor(points[:, :2] / pixel - low).astype(int)
    error = points[:, 2] - highest[tuple(at.T)]
    error = error[np.isfinite(error)]
    print(f"elevation: {len(points) * pixel ** 2:.1f} m2, RMSE {1000 * np.sqrt((error ** 2).mean()):.1f} mm, "
          f"median |error| {1000 * np.median(np.abs(error)):.1f} mm, 90 % within "
          f"{1000 * np.quantile(np.abs(error), 0.9):.1f} mm, bias {1000 * np.median(error):.1f} mm")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("dive", type=pathlib.Path)
    parser.add_argument("run", type=pathlib.Path)
    parser.add_argument("--mesh", type=pathlib.Path)
    parser.add_argument("--elevation", type=pathlib.Path)
    parser.add_argument("--distance", type=float, default=0.02)
    parser.add_argument("--views", type=int, default=3)
    a = parser.parse_args()
    rotation, offset = alignment(a.dive, a.run)
    path = read_tum(a.dive / "truth/trajectory.tum")[1]
    truth = Mesh(a.dive / "truth/mesh.ply").cropped(path.min(0) - MARGIN_m, path.max(0) + MARGIN_m)
    mesh = a.mesh or a.run / "mesh/mesh.ply"
    if mesh.exists():
        compare_mesh(mesh, truth, a.dive, lambda p: p @ rotation.T + offset, a.distance, a.views)
    elevation = a.elevation or a.run / "elevation/elevation.tif"
    if elevation.exists():
        compare_elevation(elevation, truth, rotation, offset)


if __name__ == "__main__":
    main()
