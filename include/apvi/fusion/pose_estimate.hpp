// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <numbers>

#include "apvi/dipo/dipo.hpp"
#include "apvi/geometry/se3.hpp"

/// Poses with uncertainty. Tangent vectors are [rotation [rad], position [m]]: R ⊞ θ = R Exp(θ), in
/// the body; p ⊞ δ = p + δ, in the world. It is the order and the meaning of imu::NavIndex and of
/// vio::PoseBlock, so that covariances of both subsystems fit without a change of coordinates.
namespace apvi::fusion {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

inline constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;

/// A pose and the covariance of its error: true pose = T_world_body ⊞ error.
struct PoseEstimate {
  SE3 T_world_body;
  Matrix6 covariance = Matrix6::Identity();  ///< [rad², rad m, m²]
};

SE3 boxplus(const SE3& pose, const Vector6& delta);
/// The δ with boxplus(b, δ) = a.
Vector6 boxminus(const SE3& a, const SE3& b);

/// Mean of two matrices that differ by rounding only: m and its transpose.
inline Matrix6 symmetric(const Matrix6& m) {
  return 0.5 * (m + m.transpose());
}

/// Covariance of the attitude's error about the axes of the world [rad²].
Eigen::Matrix3d world_rotation_covariance(const PoseEstimate& estimate);

/// The pose of DIPO's state, and its part of the covariance.
PoseEstimate pose_of(const dipo::Estimate& estimate);

bool is_finite(const SE3& pose);
bool is_finite(const PoseEstimate& estimate);

}  // namespace apvi::fusion
