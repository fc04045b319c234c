// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "vio/frontend/epipolar_check.hpp"

namespace apvi::vio {

/// Depth of a pair of rays where they are nearest, in the first camera [baselines of
/// `T_first_second`], and the angle between the rays; nullopt unless the point is in front of both.
struct TwoViewPoint {
  double depth = 0.0;
  double parallax = 0.0;  ///< [rad]
};
std::optional<TwoViewPoint> triangulate(const PointPair& pair, const SE3& T_first_second);

/// Motions of the camera that explain the pairs, with a translation of length one: T_first_second.
/// One is that of the essential matrix (five points, see `best_motion`). On a flat scene it may be
/// the wrong one of two, so the motions of the homography are added (Malis, Vargas, "Deeper
/// understanding of the homography decomposition", 2007). Those that place clearly fewer points in
/// front of both cameras than the best one are left out. `max_error` is on the plane z = 1.
std::vector<SE3> possible_motions(const std::vector<PointPair>& pairs, double max_error);

/// Median of the parallax over the pairs in front of both cameras [rad]; zero without any.
double median_parallax(const std::vector<PointPair>& pairs, const SE3& T_first_second);

}  // namespace apvi::vio
