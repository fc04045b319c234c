// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/geometry/se3.hpp"

namespace apvi::loop_closure {

/// A point of a map or a place and the ray on which a camera sees it.
struct PointOnRay {
  Eigen::Vector3d point;  ///< for poses in the map frame, z up [m]
  Eigen::Vector2d ray;    ///< on the plane z = 1 of the camera
};

/// What one image sees of a map. z of the world is up.
struct LevelView {
  SE3 T_world_camera;
  std::vector<PointOnRay> seen;
};

/// Pose of a map whose vertical is known.
struct LevelPose {
  SE3 T_world_map;  ///< a rotation about z and a translation
  /// Of the last camera in the map: position in world axes [m], heading [rad].
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Zero();
};

/// RANSAC with two points per sample (Kukelova, Bujnak, Pajdla, "Closed-form solutions to minimal
/// absolute pose problems with known vertical direction", 2010). `sigma`: of a ray on the plane
/// z = 1. Deterministic. Nullopt if no sample has a solution.
std::optional<SE3> sample_level_pose(const LevelView& view, double sigma);

/// Indices of the points of a view that fit within three `sigma`.
std::vector<std::size_t> fitting_points(const LevelView& view, const SE3& T_world_map,
                                        double sigma);

/// Robust least squares (Cauchy) over heading and translation, from an initial value. Nullopt if
/// the views do not determine the pose.
std::optional<LevelPose> fit_level_pose(const std::vector<LevelView>& views, const SE3& T_world_map,
                                        double sigma);

}  // namespace apvi::loop_closure
