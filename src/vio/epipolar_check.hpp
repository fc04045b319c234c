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

/// How the camera moved between two frames, up to the length of the way.
struct CameraMotion {
  Eigen::Quaterniond R_now_before = Eigen::Quaterniond::Identity();
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  ///< of the translation t_now_before, unit

  Eigen::Matrix3d essential() const { return essential_matrix(R_now_before, direction); }
};

/// The motion that suits most pairs, where a pair suits one whose epipolar line it is nearer to
/// than `threshold`; nothing when there are too few pairs to tell.
///
/// With a rotation from the gyro: two pairs give a direction of translation, and the best one is
/// refined together with the rotation, which may be a little off (gyro bias, camera time offset).
/// Without: the five-point method finds where to refine from. Both draw the same samples every
/// time.
std::optional<CameraMotion> best_motion(const std::vector<PointPair>& pairs,
                                        const std::optional<Eigen::Quaterniond>& R_now_before,
                                        double threshold);

}  // namespace apvi::vio
