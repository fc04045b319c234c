// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/frame_state.hpp"

#include "apvi/geometry/so3.hpp"

namespace apvi::vio {

PoseBlock to_block(const SE3& pose) {
  PoseBlock block;
  Eigen::Map<Eigen::Vector3d>(block.data()) = pose.translation;
  Eigen::Map<Eigen::Quaterniond>(block.data() + 3) = pose.rotation;
  return block;
}

SE3 ImageMotion::shift(double offset_s) const {
  const double after_s = compensated_s - offset_s;
  return {so3::exp(after_s * rate), after_s * velocity};
}

FrameState to_frame_state(const imu::NavState& state) {
  FrameState frame{.pose = to_block(state.pose()), .motion = {}};
  Eigen::Map<Eigen::Vector3d>(frame.motion.data()) = state.R_world_body * state.v_body;
  Eigen::Map<Eigen::Vector3d>(frame.motion.data() + 3) = state.gyro_bias;
  Eigen::Map<Eigen::Vector3d>(frame.motion.data() + 6) = state.accel_bias;
  return frame;
}

imu::NavState to_nav_state(const FrameState& state) {
  const SE3 pose = to_se3(state.pose.data());
  const double* motion = state.motion.data();
  return {.R_world_body = pose.rotation,
          .p_world = pose.translation,
          .v_body = pose.rotation.conjugate() * Eigen::Map<const Eigen::Vector3d>(motion),
          .gyro_bias = Eigen::Map<const Eigen::Vector3d>(motion + 3),
          .accel_bias = Eigen::Map<const Eigen::Vector3d>(motion + 6)};
}

}  // namespace apvi::vio
