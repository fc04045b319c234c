// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <numbers>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/se3.hpp"
#include "dipo/dipo.hpp"

/// Poses with uncertainty. Tangent vectors are [rotation [rad], position [m]]: R ⊞ θ = R Exp(θ), in
/// the body frame; p ⊞ δ = p + δ, in the world frame. This is the convention of imu::NavIndex and
/// vio::PoseBlock, so covariances of both estimators need no conversion.
namespace apvi::fusion {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// A pose and the covariance of its error: true pose = T_world_body ⊞ error.
struct PoseEstimate {
  SE3 T_world_body;
  Matrix6 covariance = Matrix6::Identity();  ///< [rad², rad m, m²]
};

SE3 boxplus(const SE3& pose, const Vector6& delta);
/// The δ for which boxplus(b, δ) = a.
Vector6 boxminus(const SE3& a, const SE3& b);

/// Removes asymmetry due to rounding: the mean of m and its transpose.
inline Matrix6 symmetric(const Matrix6& m) {
  return 0.5 * (m + m.transpose());
}

/// Covariance of the attitude error about the world axes [rad²].
Eigen::Matrix3d world_rotation_covariance(const PoseEstimate& estimate);

/// The pose and pose covariance of a DIPO estimate.
PoseEstimate pose_of(const dipo::Estimate& estimate);

/// Covariance of a marginal information, regularized by a weak prior (3 rad, 1 km) so that it
/// always exists.
Matrix6 covariance_of(const Matrix6& information);

bool is_finite(const SE3& pose);
bool is_finite(const PoseEstimate& estimate);

}  // namespace apvi::fusion
