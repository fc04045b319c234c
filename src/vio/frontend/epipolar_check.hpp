// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

namespace apvi::vio {

/// One point in two frames, on the plane z = 1 of the camera, undistorted.
struct PointPair {
  Eigen::Vector2d before;
  Eigen::Vector2d now;
};

/// Sampson distance of a pair from the epipolar geometry E with now' E before = 0, on the plane z =
/// 1.
double epipolar_distance(const Eigen::Matrix3d& essential, const PointPair& pair);
/// Essential matrix of a motion.
Eigen::Matrix3d essential_matrix(const Eigen::Quaterniond& R_now_before,
                                 const Eigen::Vector3d& t_now_before);

/// Motion of the camera between two frames, up to scale.
struct CameraMotion {
  Eigen::Quaterniond R_now_before = Eigen::Quaterniond::Identity();
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  ///< of the translation t_now_before, unit

  Eigen::Matrix3d essential() const { return essential_matrix(R_now_before, direction); }
};

/// The motion with the most inlier pairs, by distance to the epipolar line below `threshold`;
/// nullopt with too few pairs.
///
/// With a rotation from the gyro: two pairs give a direction of translation, and the best one is
/// refined together with the rotation, which may be slightly off (gyro bias, camera time offset).
/// Without: the five-point method gives the initial motion. Both are deterministic.
std::optional<CameraMotion> best_motion(const std::vector<PointPair>& pairs,
                                        const std::optional<Eigen::Quaterniond>& R_now_before,
                                        double threshold);

}  // namespace apvi::vio
