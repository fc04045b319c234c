// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/pose_estimate.hpp"

#include <Eigen/Cholesky>

#include "apvi/geometry/so3.hpp"

namespace apvi::fusion {

SE3 boxplus(const SE3& pose, const Vector6& delta) {
  return {(pose.rotation * so3::exp(delta.head<3>())).normalized(),
          pose.translation + delta.tail<3>()};
}

Vector6 boxminus(const SE3& a, const SE3& b) {
  Vector6 delta;
  delta << so3::log(b.rotation.conjugate() * a.rotation), a.translation - b.translation;
  return delta;
}

Eigen::Matrix3d world_rotation_covariance(const PoseEstimate& estimate) {
  const Eigen::Matrix3d R = estimate.T_world_body.rotation.toRotationMatrix();
  const Eigen::Matrix3d block = symmetric(estimate.covariance).topLeftCorner<3, 3>();
  return R * block * R.transpose();
}

PoseEstimate pose_of(const dipo::Estimate& estimate) {
  static_assert(imu::kTheta == 0 && imu::kPosition == 3);
  const imu::NavState& nav = estimate.state.nav;
  return {nav.pose(), estimate.covariance.topLeftCorner<6, 6>()};
}

Matrix6 covariance_of(const Matrix6& information) {
  constexpr double kUnknownRotation = 3.0;  // [rad]
  constexpr double kUnknownDistance = 1e3;  // [m]
  Vector6 ridge;
  ridge.head<3>().setConstant(1.0 / (kUnknownRotation * kUnknownRotation));
  ridge.tail<3>().setConstant(1.0 / (kUnknownDistance * kUnknownDistance));
  const Matrix6 sum = symmetric(information) + Matrix6(ridge.asDiagonal());
  return symmetric(sum.ldlt().solve(Matrix6::Identity()));
}

bool is_finite(const SE3& pose) {
  return pose.rotation.coeffs().allFinite() && pose.translation.allFinite();
}

bool is_finite(const PoseEstimate& estimate) {
  return is_finite(estimate.T_world_body) && estimate.covariance.allFinite();
}

}  // namespace apvi::fusion
