// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/map_feed.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace apvi::pipeline {
namespace {

constexpr std::size_t kMostRanged = 256;  // points between two frames that go out

// What the map may be made of: vision works, and its judge says so.
bool is_stable(const FrameOutput& output) {
  const auto state = output.fusion.state;
  const bool trusted =
      state == fusion::FusionState::fused || state == fusion::FusionState::vio_only;
  const bool sees =
      output.vio.status == vio::Status::tracking || output.vio.status == vio::Status::started;
  return !output.dropped && trusted && sees && output.vio.landmarks > 0;
}

// By the law of sines: the depth error of two rays that meet under a small angle.
double depth_sigma(const vio::Landmark& landmark, const vio::Window& window, double ray_sigma) {
  const auto& first = landmark.sightings.front();
  const SE3 anchor = vio::camera_pose(first, window);
  const Eigen::Vector3d point = vio::position(landmark, window);
  const Eigen::Vector3d ray = point - anchor.translation;
  double parallax = 0.0;
  for (const auto& sighting : landmark.sightings) {
    const Eigen::Vector3d other = point - vio::camera_pose(sighting, window).translation;
    parallax = std::max(parallax, std::atan2(ray.cross(other).norm(), ray.dot(other)));
  }
  return ray.norm() * ray_sigma / std::max(1e-6, std::sin(parallax));
}

}  // namespace

MapFeed::MapFeed(const RunConfig& config, const Rig& rig)
    : heldout_every_(static_cast<std::size_t>(config.eval.heldout_every)),
      ray_sigma_(config.vio.vision.pixel_sigma / rig.cameras.front().model.parameters().fx),
      min_sightings_(config.vio.vision.min_sightings) {}

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
  if (output.vio.has_state()) note_ranges(job, output.vio.state);
  const bool wanted = stable && !image.empty() && (held_out || output.vio.keyframe);
  if (!wanted && !changed) return std::nullopt;

  MapFrame frame;
  frame.stamp = job.stamp;
  frame.vio_failing = failing_;
  for (const auto& kept : window.frames) {
    if (kept->stamp == job.stamp) continue;
    frame.window.push_back({kept->stamp, vio::to_se3(kept->state.pose.data())});
    frame.newest_keyframe = kept->stamp;
  }
  if (!wanted) return frame;
  frame.image_stamp = job.images.front().stamp;
  frame.image = image;
  frame.held_out = held_out;
  if (held_out) frame.number = static_cast<std::int64_t>((images_ - 1) / heldout_every_);
  frame.T_world_body = output.vio.state.pose();
  if (held_out) return frame;
  frame.points = points(window);
  frame.ranged = std::exchange(ranged_, {});
  return frame;
}

std::vector<MapPoint> MapFeed::points(const vio::Window& window) const {
  std::vector<MapPoint> points;
  for (const auto& [id, landmark] : window.landmarks) {
    if (!vio::takes_part(landmark, min_sightings_)) continue;
    points.push_back(
        {id, vio::position(landmark, window), depth_sigma(landmark, window, ray_sigma_)});
  }
  return points;
}

void MapFeed::note_ranges(const FrameJob& job, const imu::NavState& state) {
  const SE3 pose = state.pose();
  for (const RangedPing& ping : job.ranges) {
    const Eigen::Vector3d moved = state.v_body * seconds_between(job.stamp, ping.stamp);
    for (const Eigen::Vector3d& point : ping.points) ranged_.push_back(pose * (point + moved));
  }
  if (ranged_.size() > kMostRanged) ranged_.clear();
}

}  // namespace apvi::pipeline
