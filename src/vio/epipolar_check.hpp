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

/// Distance of a pair from the epipolar geometry E with now' E before = 0 (Sampson's, first order
/// in the error of both points), on the plane z = 1.
double epipolar_distance(const Eigen::Matrix3d& essential, const PointPair& pair);
/// Essential matrix of a motion.
Eigen::Matrix3d essential_matrix(const Eigen::Quaterniond& R_now_before,
                                 const Eigen::Vector3d& t_now_before);

/// The essential matrix that suits most pairs, where a pair suits one that it is nearer to than
/// `threshold`; nothing when there are too few pairs to tell.
///
/// With a rotation from the gyro: two pairs give a direction of translation, and the best one is
/// refined together with the rotation, which may be a little off (gyro bias, camera time offset).
/// Without: the five-point method. Both draw the same samples every time.
std::optional<Eigen::Matrix3d> best_essential(const std::vector<PointPair>& pairs,
                                              const std::optional<Eigen::Quaterniond>& R_now_before,
                                              double threshold);

}  // namespace apvi::vio
