// SPDX-License-Identifier: BSD-3-Clause
#include "vio/state_prior.hpp"

#include "apvi/geometry/so3.hpp"

namespace apvi::vio {

SE3 level_alignment(const SE3& here, const SE3& there) {
  const double yaw = so3::yaw(here.rotation * there.rotation.conjugate());
  const Eigen::Quaterniond turn = so3::exp(Eigen::Vector3d(0.0, 0.0, yaw));
  return {turn, here.translation - turn * there.translation};
}

imu::NavState transformed(const SE3& T, imu::NavState state) {
  const SE3 pose = T * state.pose();
  state.R_world_body = pose.rotation;
  state.p_world = pose.translation;
  return state;
}

StatePrior transformed(const SE3& T, const StatePrior& prior) {
  StatePrior result{transformed(T, prior.state), prior.covariance};
  const Eigen::Matrix3d R = T.rotation.toRotationMatrix();
  result.covariance.middleRows<3>(imu::kPosition).applyOnTheLeft(R);
  result.covariance.middleCols<3>(imu::kPosition).applyOnTheRight(R.transpose());
  return result;
}

}  // namespace apvi::vio
