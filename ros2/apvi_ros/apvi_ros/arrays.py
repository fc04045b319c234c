# SPDX-License-Identifier: BSD-3-Clause
"""Poses and maps as the numbers that messages take, without ROS."""
import numpy as np

MIN_OPACITY = 0.5  # of the Gaussians that a point cloud shows
POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("rgb", "<u4")])


def quaternion_of(T):
    """x, y, z, w of a pose [4,4], with w >= 0. Shepperd 1978: the largest component first."""
    R = np.asarray(T)[:3, :3]
    squares = np.array([1 + 2 * R[i, i] - np.trace(R) for i in range(3)] + [1 + np.trace(R)])
    largest = int(np.argmax(squares))
    q = np.empty(4)
    if largest == 3:
        q[:] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], squares[3]
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i], q[j], q[k], q[3] = squares[i], R[j, i] + R[i, j], R[k, i] + R[i, k], R[k, j] - R[j, k]
    q /= np.linalg.norm(q)
    return q if q[3] >= 0 else -q


def points_of(snapshot):
    """The centers of the opaque Gaussians with their colors: an array of POINT."""
    opaque = snapshot.logit_opacities > np.log(MIN_OPACITY / (1 - MIN_OPACITY))
    colors = (255 * np.clip(snapshot.colors[opaque], 0, 1) + 0.5).astype(np.uint32)
    points = np.empty(int(opaque.sum()), POINT)
    points["x"], points["y"], points["z"] = (snapshot.means[opaque] + snapshot.origin).T
    points["rgb"] = colors[:, 0] << 16 | colors[:, 1] << 8 | colors[:, 2]
    return points


def pixels_of(images, view):
    """(encoding, array) of a rendered image: rgb8 [h,w,3] of color or restored, 32FC1 [h,w] of depth."""
    if view == "depth":
        return "32FC1", images.depth
    values = images.restored if view == "restored" else images.color
    return "rgb8", (255 * np.clip(values, 0, 1) + 0.5).astype(np.uint8)
