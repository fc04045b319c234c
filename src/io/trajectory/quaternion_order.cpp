// SPDX-License-Identifier: BSD-3-Clause
#include "io/trajectory/quaternion_order.hpp"

#include <algorithm>
#include <cmath>

#include "apvi/core/log.hpp"

namespace apvi::io {
namespace {

// The first component of the identity in the other order is 1 as read: x where w is last, z where w
// is first. That alone proves nothing: it is also a level body whose z axis points down, or one
// that faces backward.
constexpr double kIdentity = 0.99998;  // within 0.7 degrees
constexpr double kMinTilt = 0.77;      // cosine of 40 degrees

double component_of_identity(const Eigen::Quaterniond& q, bool w_first) {
  return std::abs(w_first ? q.z() : q.x());
}

}  // namespace

void check_quaternion_order(const Trajectory& trajectory, bool w_first, const std::string& name) {
  if (trajectory.empty() || !trajectory.has_rotation) return;
  const auto& poses = trajectory.poses;
  const Eigen::Quaterniond& first = poses.front().T_world_body.rotation;
  if (component_of_identity(first, w_first) < kIdentity) return;
  const Eigen::Vector3d up = first * Eigen::Vector3d::UnitZ();
  const bool tilts = std::any_of(poses.begin(), poses.end(), [&](const StampedPose& pose) {
    return up.dot(pose.T_world_body.rotation * Eigen::Vector3d::UnitZ()) < kMinTilt;
  });
  if (!tilts) return;
  log::warning(
      "{}: without column names quaternions are read as {}, but as {} the first pose would be the "
      "identity. If that is their order, say so in a first line: {}",
      name, w_first ? "w x y z" : "x y z w", w_first ? "x y z w" : "w x y z",
      w_first ? "#timestamp,tx,ty,tz,qx,qy,qz,qw" : "# timestamp tx ty tz qw qx qy qz");
}

}  // namespace apvi::io
