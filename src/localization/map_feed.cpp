// SPDX-License-Identifier: BSD-3-Clause
#include "localization/map_feed.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sensors/reduced_camera.hpp"

namespace apvi::localization {
namespace {

constexpr std::size_t kMaxRangePoints = 256;  // points between two frames passed on

// The pose when the image was taken: its stamp may be late.
SE3 pose_of_image(Stamp stamp, const vio::Window& window, const FrameOutput& output) {
  if (window.frames.empty() || window.newest().image_stamp != stamp) {
    return output.vio.state.pose();
  }
  return vio::to_se3(window.newest().state.pose.data());
}

// Depth error of a point triangulated from two rays, by the law of sines.
double depth_sigma(const vio::Landmark& landmark, const vio::Window& window, double ray_sigma) {
  const auto& first = landmark.observations.front();
  const SE3 anchor = vio::camera_pose(first, window);
  const Eigen::Vector3d point = vio::position(landmark, window);
  const Eigen::Vector3d ray = point - anchor.translation;
  double parallax = 0.0;
  for (const auto& observation : landmark.observations) {
    const Eigen::Vector3d other = point - vio::camera_pose(observation, window).translation;
    parallax = std::max(parallax, std::atan2(ray.cross(other).norm(), ray.dot(other)));
  }
  return ray.norm() * ray_sigma / std::max(1e-6, std::sin(parallax));
}

// Of corners, in the images that are tracked.
double ray_sigma_of(const vio::Config& vio, const Rig& rig) {
  const Rig tracked = reduced(rig, vio.tracker.max_image_side_px);
  return vio.vision.pixel_sigma / tracked.cameras.front().model.parameters().fx;
}

}  // namespace

bool is_stable(const FrameOutput& output) {
  const auto state = output.fusion.state;
  const bool trusted =
      state == fusion::FusionState::fused || state == fusion::FusionState::vio_only;
  const bool sees =
      output.vio.status == vio::Status::tracking || output.vio.status == vio::Status::started;
  return !output.dropped && trusted && sees && output.vio.landmarks > 0;
}

MapFeed::MapFeed(const Options& options, const Rig& rig)
    : heldout_every_(static_cast<std::size_t>(options.heldout_every)),
      ray_sigma_(ray_sigma_of(options.vio, rig)),
      min_observations_(options.vio.vision.min_observations) {}

std::optional<MapFrame> MapFeed::process(const FrameJob& job, const cv::Mat& image,
                                         const FrameOutput& output, const vio::Window& window) {
  const bool recorded = !job.images.empty() && job.images.front().decode;
  const bool held_out = recorded && heldout_every_ > 0 && images_ % heldout_every_ == 0;
  if (recorded) ++images_;
  const bool stable = is_stable(output);
  const bool failing = !stable && was_stable_;
  const bool changed = failing != failing_;
  if (!output.dropped) failing_ = failing;
  was_stable_ = was_stable_ || stable;
  if (output.vio.has_state()) add_range_points(job, output.vio.state);
  const bool needed = stable && !image.empty() && (held_out || output.vio.keyframe);
  if (!needed && !changed && !output.scale_found) return std::nullopt;

  MapFrame frame;
  if (output.scale_found) frame.scale_change = output.scale_found->to_meters;
  frame.stamp = job.stamp;
  frame.vio_failing = failing_;
  for (const auto& kept : window.frames) {
    if (kept->image_stamp == job.stamp) continue;
    frame.window.push_back({kept->image_stamp, vio::to_se3(kept->state.pose.data())});
    frame.newest_keyframe = kept->image_stamp;
  }
  for (const StampedPose& earlier : output.vio.earlier) frame.window.push_back(earlier);
  if (!needed) return frame;
  frame.image_stamp = job.images.front().stamp;
  frame.image = image;
  frame.mask = job.images.front().mask;
  frame.held_out = held_out;
  if (held_out) frame.heldout_index = static_cast<std::int64_t>((images_ - 1) / heldout_every_);
  frame.T_world_body = pose_of_image(job.stamp, window, output);
  frame.T_body_camera = vio::to_se3(window.calibration.T_body_camera.front().data());
  if (held_out) return frame;
  frame.points = points(window);
  frame.range_points = std::exchange(range_points_, {});
  return frame;
}

std::vector<MapPoint> MapFeed::points(const vio::Window& window) const {
  std::vector<MapPoint> points;
  for (const auto& [id, landmark] : window.landmarks) {
    if (!vio::is_in_graph(landmark, min_observations_)) continue;
    points.push_back(
        {id, vio::position(landmark, window), depth_sigma(landmark, window, ray_sigma_)});
  }
  return points;
}

void MapFeed::add_range_points(const FrameJob& job, const imu::NavState& state) {
  const SE3 pose = state.pose();
  for (const RangePoints& ping : job.range_points) {
    const Eigen::Vector3d moved = state.v_body * seconds_between(job.stamp, ping.stamp);
    for (const Eigen::Vector3d& point : ping.points)
      range_points_.push_back(pose * (point + moved));
  }
  if (range_points_.size() > kMaxRangePoints) range_points_.clear();
}

}  // namespace apvi::localization
