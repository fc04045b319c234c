// SPDX-License-Identifier: BSD-3-Clause
#include "slam/final_poses.hpp"

#include <vector>

#include "geometry/umeyama.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::slam {

std::optional<SE3> final_motion(const mapping::KeyframeStore& keyframes,
                                const Trajectory& final_camera_poses) {
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (const StampedPose& pose : final_camera_poses.poses) {
    const auto found = keyframes.by_stamp().find(pose.stamp.ns);
    if (found == keyframes.by_stamp().end() || keyframes[found->second].held_out) continue;
    from.push_back(to_se3(keyframes[found->second].T_camera_world).inverse().translation);
    to.push_back(pose.T_world_body.translation);
  }
  return align_yaw(from, to);
}

}  // namespace apvi::slam
