// SPDX-License-Identifier: BSD-3-Clause
#include "sim/motion/file_motion.hpp"

#include <algorithm>
#include <numbers>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "apvi/io/tum.hpp"

namespace apvi::sim {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector3d;

Trajectory from_ned(Trajectory trajectory) {
  // A rotation by pi about (x + y) / sqrt(2) maps NED to ENU; one by pi about x maps FRD to FLU.
  const Quaterniond up_ned(0.0, std::numbers::sqrt2 / 2.0, std::numbers::sqrt2 / 2.0, 0.0);
  const Quaterniond frd_flu(0.0, 1.0, 0.0, 0.0);
  for (StampedPose& pose : trajectory.poses) {
    pose.T_world_body = {(up_ned * pose.T_world_body.rotation * frd_flu).normalized(),
                         up_ned * pose.T_world_body.translation};
  }
  return trajectory;
}

void move_to_origin(const MotionConfig& config, Trajectory& trajectory) {
  const SE3 first = trajectory.poses.front().T_world_body;
  const double turn = config.heading_deg * kRadiansPerDegree - so3::yaw(first.rotation);
  const Quaterniond rotation(AngleAxisd(turn, Vector3d::UnitZ()));
  const Vector3d origin(config.origin[0], config.origin[1], config.origin[2]);
  const SE3 T_here_file{rotation, origin - rotation * first.translation};
  for (StampedPose& pose : trajectory.poses) pose.T_world_body = T_here_file * pose.T_world_body;
}

}  // namespace

Se3Spline motion_from_file(const MotionConfig& config, const MotionContext& context) {
  if (config.file.empty()) fail_input("motion.file: required for motion.path: file");
  Trajectory trajectory = io::read_trajectory(config.file);
  if (!trajectory.has_rotation) {
    fail_input("{}: the trajectory has no orientations", config.file);
  }
  const Duration period = Duration::from_seconds(config.file_period_s);
  const double length = trajectory.empty() ? 0.0
                                           : seconds_between(trajectory.poses.front().stamp,
                                                             trajectory.poses.back().stamp) -
                                                 config.file_period_s;
  if (length < context.duration_s) {
    fail_input("{}: the trajectory is too short: it covers {:.1f} s, but duration_s is {:.1f} s",
               config.file, std::max(length, 0.0), context.duration_s);
  }
  if (config.file_frame == FileFrame::ned) trajectory = from_ned(std::move(trajectory));
  if (config.file_at_origin) move_to_origin(config, trajectory);
  const Duration shift = context.start - trajectory.poses.front().stamp;
  for (StampedPose& pose : trajectory.poses) pose.stamp = pose.stamp + shift;
  return Se3Spline::through(trajectory, period);
}

}  // namespace apvi::sim
