# SPDX-License-Identifier: BSD-3-Clause
"""Compares an estimate with a reference, like `apvi eval`."""
import dataclasses

import numpy as np

from .run_data import Track


@dataclasses.dataclass
class Motion:
    """x -> R x + t."""
    R: np.ndarray
    t: np.ndarray

    def apply(self, track):
        R = None if track.R is None else self.R @ track.R
        return Track(track.t, track.p @ self.R.T + self.t, R, track.planar)

    def inverse(self):
        return Motion(self.R.T, -self.R.T @ self.t)


@dataclasses.dataclass
class Comparison:
    """The estimate aligned to the reference, and the errors at the stamps of the pairs."""
    motion: Motion
    alignment: str          # in words
    t: np.ndarray
    position: np.ndarray    # [m]
    rotation: np.ndarray    # [deg], or None
    axes: int               # of the position error: 2 for a planar reference

    @property
    def rmse(self):
        return float(np.sqrt(np.mean(self.position**2)))


def slerp(R0, R1, fraction):
    """Spherical interpolation of rotations [n, 3, 3] by fractions [n]."""
    step = np.swapaxes(R0, 1, 2) @ R1
    angle = angles(step)
    skew = (step - np.swapaxes(step, 1, 2)) / 2.0
    axis = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-12)
    return R0 @ rotations_about(axis, fraction * angle)


def rotations_about(axis, angle):
    """Rodrigues: unit axes [n, 3], angles [n]."""
    K = np.zeros((len(angle), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    K -= np.swapaxes(K, 1, 2)
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * K + (1.0 - c) * K @ K


def angles(R):
    """Angles of rotations [n, 3, 3] in radians; accurate for small angles."""
    skew = (R - np.swapaxes(R, 1, 2)) / 2.0
    sine = np.sqrt(skew[:, 2, 1]**2 + skew[:, 0, 2]**2 + skew[:, 1, 0]**2)
    return np.arctan2(sine, (np.trace(R, axis1=1, axis2=2) - 1.0) / 2.0)


def interpolate(track, t, max_gap_s):
    """The track interpolated at those times t that it covers, and a mask of these times."""
    after = np.clip(np.searchsorted(track.t, t), 1, len(track) - 1)
    before = after - 1
    gap = track.t[after] - track.t[before]
    covered = (t >= track.t[0]) & (t <= track.t[-1]) & (gap <= max_gap_s)
    before, after, gap, t = before[covered], after[covered], gap[covered], t[covered]
    f = np.divide(t - track.t[before], gap, out=np.zeros_like(t), where=gap > 0.0)
    p = track.p[before] + f[:, None] * (track.p[after] - track.p[before])
    R = None if track.R is None else slerp(track.R[before], track.R[after], f)
    return Track(t, p, R, track.planar), covered


def select(track, keep):
    return Track(track.t[keep], track.p[keep], None if track.R is None else track.R[keep],
                 track.planar)


def associate(reference, estimate, max_gap_s):
    """Both tracks at common stamps: the denser one is interpolated at the stamps of the other."""
    first, last = max(reference.t[0], estimate.t[0]), min(reference.t[-1], estimate.t[-1])
    if first > last:
        return None
    in_span = [np.count_nonzero((track.t >= first) & (track.t <= last))
               for track in (reference, estimate)]
    if in_span[0] > in_span[1]:
        found, covered = interpolate(reference, estimate.t, max_gap_s)
        return found, select(estimate, covered)
    found, covered = interpolate(estimate, reference.t, max_gap_s)
    return select(reference, covered), found


def umeyama(target, source):
    """Least-squares rigid motion (R, t) from source to target, both [n, d].

    S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns",
    1991, without the scale.
    """
    mean_target, mean_source = target.mean(axis=0), source.mean(axis=0)
    U, _, Vt = np.linalg.svd((target - mean_target).T @ (source - mean_source))
    S = np.eye(target.shape[1])
    S[-1, -1] = np.sign(np.linalg.det(U @ Vt))
    R = U @ S @ Vt
    return R, mean_target - R @ mean_source


def level_motion(reference, estimate):
    """Alignment by a rotation about the vertical and a translation."""
    motion = Motion(np.eye(3), np.zeros(3))
    motion.R[:2, :2], motion.t[:2] = umeyama(reference.p[:, :2], estimate.p[:, :2])
    motion.t[2] = 0.0 if reference.planar else np.mean(reference.p[:, 2] - estimate.p[:, 2])
    return motion


def find_motion(reference, estimate, mode):
    """The alignment and its description."""
    if mode == "none":
        return Motion(np.eye(3), np.zeros(3)), "not aligned"
    if mode == "first" and reference.R is not None:
        R = reference.R[0] @ estimate.R[0].T
        return Motion(R, reference.p[0] - R @ estimate.p[0]), "aligned at the first pose"
    if mode == "yaw" or reference.planar:
        plane = "in the plane " if reference.planar else "about the vertical "
        return level_motion(reference, estimate), f"aligned {plane}by least squares (Umeyama)"
    return Motion(*umeyama(reference.p, estimate.p)), "aligned by SE(3) Umeyama"


def compare(run):
    """None without a reference or with too few common poses."""
    if run.reference is None or len(run.reference) < 2 or len(run.estimate) < 2:
        return None
    max_gap_s = float(run.setting("eval", "max_gap_s", default="2"))
    pairs = associate(run.reference, run.estimate, max_gap_s)
    if pairs is None or len(pairs[0]) < 3:
        return None
    reference, estimate = pairs
    motion, alignment = find_motion(reference, estimate, run.setting("eval", "align", default="se3"))
    moved = motion.apply(estimate)
    axes = 2 if reference.planar else 3
    rotation = None
    if reference.R is not None:
        rotation = np.degrees(angles(np.swapaxes(reference.R, 1, 2) @ moved.R))
    return Comparison(motion, alignment, reference.t,
                      np.linalg.norm((moved.p - reference.p)[:, :axes], axis=1), rotation, axes)
