// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <optional>

#include "apvi/geometry/se3.hpp"
#include "vio/window/observation.hpp"

namespace apvi::vio {

/// Positions by track [m, or the unit of the map].
using PointsById = std::map<std::int64_t, Eigen::Vector3d>;

/// Pose of the first camera in the world, from known points that the frame observes: perspective-3
/// -point with RANSAC, then least squares (OpenCV). `max_error` is on the plane z = 1. nullopt with
/// fewer than `min_points` that agree, or when less than half of the observed points do.
std::optional<SE3> resect(const TrackedFrame& frame, const PointsById& points, double max_error,
                          std::size_t min_points);

}  // namespace apvi::vio
