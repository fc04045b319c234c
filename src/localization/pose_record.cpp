// SPDX-License-Identifier: BSD-3-Clause
#include "localization/pose_record.hpp"

#include <utility>

namespace apvi::localization {

PoseRecord::PoseRecord(std::function<void(const StampedPose&)> pose,
                       std::function<void(const ScaleFound&)> scale_found)
    : pose_(std::move(pose)), scale_found_(std::move(scale_found)) {}

void PoseRecord::add(const StampedPose& pose) {
  {
    const std::scoped_lock lock(mutex_);
    trajectory_.merge({pose});
  }
  if (pose_) pose_(pose);
}

void PoseRecord::change_scale(const ScaleFound& found) {
  {
    const std::scoped_lock lock(mutex_);
    apply(found, trajectory_);
  }
  if (scale_found_) scale_found_(found);
}

void PoseRecord::clear() {
  const std::scoped_lock lock(mutex_);
  trajectory_ = {};
  T_map_odom_ = {};
}

void PoseRecord::set_map_to_odometry(const SE3& T_map_odom) {
  const std::scoped_lock lock(mutex_);
  T_map_odom_ = T_map_odom;
}

SE3 PoseRecord::T_map_odom() const {
  const std::scoped_lock lock(mutex_);
  return T_map_odom_;
}

Trajectory PoseRecord::trajectory() const {
  const std::scoped_lock lock(mutex_);
  return trajectory_;
}

std::size_t PoseRecord::size() const {
  const std::scoped_lock lock(mutex_);
  return trajectory_.size();
}

std::optional<StampedPose> PoseRecord::newest() const {
  const std::scoped_lock lock(mutex_);
  return trajectory_.empty() ? std::nullopt : std::optional(trajectory_.poses.back());
}

}  // namespace apvi::localization
