// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/geometry/se3.hpp"

namespace apvi::loop_closure {

/// A point of a map and the ray on which a camera sees it.
struct PointOnRay {
  Eigen::Vector3d point;  ///< in the map frame, z up [m]
  Eigen::Vector2d ray;    ///< on the plane z = 1 of the camera
};

struct LevelPose {
  SE3 T_world_map;                   ///< a rotation about z and a translation
  std::vector<std::size_t> inliers;  ///< indices of the points that fit
};

/// Pose of a map whose vertical is known, from one image of a camera at `T_world_camera`: RANSAC
/// with two points per sample (Kukelova, Bujnak, Pajdla, "Closed-form solutions to minimal absolute
/// pose problems with known vertical direction", 2010), then robust least squares over the four
/// degrees of freedom. `sigma`: of a ray on the plane z = 1. Deterministic. Nullopt unless
/// `min_inliers` points fit within three `sigma`.
std::optional<LevelPose> find_level_pose(const std::vector<PointOnRay>& seen,
                                         const SE3& T_world_camera, double sigma,
                                         std::size_t min_inliers);

}  // namespace apvi::loop_closure
