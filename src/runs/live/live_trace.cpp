// SPDX-License-Identifier: BSD-3-Clause
#include "runs/live/live_trace.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "apvi/localization/system.hpp"

namespace apvi::runs {
namespace {

constexpr double kMinShift_m = 0.01;
constexpr double kMaxGap_s = 0.5;  // of the odometry around a keyframe

struct Correction {
  Stamp stamp;
  SE3 T_map_odom;
};

Trajectory path_of(const std::vector<viewer::TracePose>& trace) {
  Trajectory path;
  for (const viewer::TracePose& p : trace) path.poses.push_back(p.pose);
  return path;
}

std::vector<Correction> corrections_of(const Trajectory& odometry, const Trajectory& keyframes) {
  std::vector<Correction> all;
  for (const StampedPose& keyframe : keyframes.poses) {
    const auto pose = odometry.at(keyframe.stamp, Duration::from_seconds(kMaxGap_s));
    if (pose) all.push_back({keyframe.stamp, keyframe.T_world_body * pose->inverse()});
  }
  return all;
}

// Between the corrections of the two keyframes around it.
SE3 corrected(const StampedPose& pose, const std::vector<Correction>& all) {
  const auto after = std::ranges::upper_bound(all, pose.stamp, {}, &Correction::stamp);
  const Correction& b = after == all.end() ? all.back() : *after;
  const Correction& a = after == all.begin() ? b : *std::prev(after);
  const double span_s = seconds_between(a.stamp, b.stamp);
  const double u = span_s > 0.0 ? seconds_between(a.stamp, pose.stamp) / span_s : 0.0;
  return interpolate(a.T_map_odom * pose.T_world_body, b.T_map_odom * pose.T_world_body, u);
}

}  // namespace

void LiveTrace::add(const StampedPose& pose, const std::string& state) {
  odometry_.push_back({pose, state});
  shown_.push_back({{pose.stamp, newest_ * pose.T_world_body}, state});
}

bool LiveTrace::rewrite(const localization::FrameOutput& output) {
  if (!output.scale_found && output.vio.earlier.empty()) return false;
  Trajectory path = path_of(odometry_);
  if (output.scale_found) localization::apply(*output.scale_found, path);
  path.merge(output.vio.earlier);
  const std::string state(output.pose_source());
  odometry_.clear();
  for (const StampedPose& pose : path.poses) odometry_.push_back({pose, state});
  shown_ = odometry_;
  newest_ = SE3::identity();
  return true;
}

bool LiveTrace::follow(const Trajectory& keyframes) {
  const std::vector<Correction> all = corrections_of(path_of(odometry_), keyframes);
  if (all.empty()) return false;
  std::vector<viewer::TracePose> moved = odometry_;
  double largest_m = 0.0;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    SE3& pose = moved[i].pose.T_world_body;
    pose = corrected(odometry_[i].pose, all);
    const Eigen::Vector3d shift = pose.translation - shown_[i].pose.T_world_body.translation;
    largest_m = std::max(largest_m, shift.norm());
  }
  if (largest_m < kMinShift_m) return false;
  shown_ = std::move(moved);
  newest_ = all.back().T_map_odom;
  return true;
}

}  // namespace apvi::runs
