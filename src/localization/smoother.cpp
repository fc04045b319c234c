// SPDX-License-Identifier: BSD-3-Clause
#include "localization/smoother.hpp"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>

#include "localization/map_feed.hpp"
#include "vio/state_prior.hpp"

namespace apvi::localization {
namespace {

constexpr double kPoseStep_s = 1.0;  // between keyframes without an image
// At first, the known map is searched for in more images than the keyframes.
constexpr double kSearch_s = 20.0;
constexpr double kSearchStep_s = 0.19;  // that stamps may be inexact

loop_closure::LoopThread thread_of(RunMode mode) {
  switch (mode) {
    case RunMode::sequential:
      return loop_closure::LoopThread::none;
    case RunMode::replay:
      return loop_closure::LoopThread::blocking;
    case RunMode::realtime:
      return loop_closure::LoopThread::skipping;
  }
  return loop_closure::LoopThread::none;
}

loop_closure::CloserOptions closer_options(const Options& options, const CameraCalibration& camera,
                                           bool for_map) {
  loop_closure::CloserOptions closer = loop_closure::closer_options(options.smoothing);
  closer.lists_corrections = for_map;
  closer.mask = camera.mask;
  const auto sigma = [](const vio::CalibrationPrior& prior) {
    return prior.estimate ? prior.sigma : 0.0;
  };
  const vio::CalibrationConfig& calibration = options.vio.calibration;
  closer.camera_prior = {.T_body_camera = camera.T_body_camera,
                         .mounting_rad = sigma(calibration.camera_mounting),
                         .lever_arm_m = sigma(calibration.camera_lever_arm),
                         .focal_length = sigma(calibration.focal_length),
                         .principal_point = sigma(calibration.principal_point)};
  const std::string& run = options.smoothing.known_map;
  if (run.empty()) return closer;
  closer.known_map = std::make_shared<loop_closure::KnownMap>(
      loop_closure::load_place_map(loop_closure::find_place_map(run)), camera.model,
      options.smoothing.pixel_sigma);
  return closer;
}

}  // namespace

Smoother::Smoother(const Options& options, const Rig& rig, const ActiveSensors& sensors,
                   bool for_map)
    : T_body_camera_(rig.cameras.front().T_body_camera),
      height_is_measured_(sensors.dvl && options.sensors.includes("pressure") &&
                          (rig.pressure || rig.depth)),
      drift_factor_(options.smoothing.drift_factor),
      has_known_map_(!options.smoothing.known_map.empty()),
      closer_(closer_options(options, rig.cameras.front(), for_map), rig.cameras.front().model,
              thread_of(options.run.mode)) {}

// Poses up to scale are no odometry in meters.
void Smoother::add(const FrameOutput& output, const cv::Mat& image,
                   const std::optional<MapFrame>& news) {
  if (!output.fusion.pose || output.vio.up_to_scale) return;
  if (!stamps_.empty() && output.stamp <= stamps_.back()) return;
  drift_.add(output);
  if (news) move_window(*news);
  const bool has_image = news && !news->image.empty();
  const bool continues = !in_window_.empty();
  if (has_image && !continues) place_window(output);
  if (has_image && !news->held_out) return add_image(output, *news, continues);
  if (!image.empty() && is_search_due(output)) return add_pose(output, image);
  const bool due = !stamps_.empty() && seconds_between(stamps_.back(), output.stamp) >= kPoseStep_s;
  if (due) add_pose(output, {});
}

// By time alone, so that threads do not change the result.
bool Smoother::is_search_due(const FrameOutput& output) const {
  return has_known_map_ && last_image_ && is_stable(output) &&
         seconds_between(stamps_.front(), output.stamp) < kSearch_s &&
         seconds_between(*last_image_, output.stamp) >= kSearchStep_s;
}

// Keyframes of the window with their present poses; in_window_ becomes those still in it.
void Smoother::move_window(const MapFrame& news) {
  std::map<Stamp, std::size_t> kept;
  for (const StampedPose& pose : news.window) {
    const auto known = in_window_.find(pose.stamp);
    if (known == in_window_.end()) continue;
    kept.insert(*known);
    Keyframe& keyframe = keyframes_[known->second];
    keyframe.T_graph_image = T_graph_window_ * pose.T_world_body;
    moved_.emplace_back(pose.stamp, keyframe.T_graph_image * keyframe.T_body_camera);
  }
  in_window_ = std::move(kept);
}

// Where odometry leads from the newest keyframe.
SE3 Smoother::predicted(const SE3& T_odom_body) const {
  if (keyframes_.empty()) return T_odom_body;
  const Keyframe& last = keyframes_.back();
  return last.T_graph_body() * last.T_odom_body.inverse() * T_odom_body;
}

void Smoother::place_window(const FrameOutput& output) {
  T_graph_window_ =
      vio::level_alignment(predicted(output.fusion.pose->T_world_body), output.vio.state.pose());
}

void Smoother::add_image(const FrameOutput& output, const MapFrame& news, bool continues) {
  in_window_[news.stamp] = keyframes_.size();
  push({.T_odom_body = output.fusion.pose->T_world_body,
        .T_graph_image = T_graph_window_ * news.T_world_body,
        .T_image_body = news.T_world_body.inverse() * output.vio.state.pose(),
        .T_body_camera = news.T_body_camera.value_or(T_body_camera_)},
       news.stamp, news.image, continues);
}

void Smoother::add_pose(const FrameOutput& output, const cv::Mat& image) {
  const SE3& T_odom_body = output.fusion.pose->T_world_body;
  push({.T_odom_body = T_odom_body,
        .T_graph_image = predicted(T_odom_body),
        .T_image_body = SE3::identity(),
        .T_body_camera = keyframes_.empty() ? T_body_camera_ : keyframes_.back().T_body_camera},
       output.stamp, image, true);
}

void Smoother::push(const Keyframe& keyframe, Stamp stamp, const cv::Mat& image,
                    bool vio_continues) {
  keyframes_.push_back(keyframe);
  stamps_.push_back(stamp);
  if (!image.empty()) last_image_ = stamp;
  {
    const std::scoped_lock lock(mutex_);
    T_graph_odom_ = keyframe.T_graph_body() * keyframe.T_odom_body.inverse();
  }
  loop_closure::LoopInput input;
  input.keyframe = {.stamp = stamp,
                    .T_world_camera = keyframe.T_graph_image * keyframe.T_body_camera,
                    .T_body_camera = keyframe.T_body_camera,
                    .drift = drift_.take(vio_continues) * (drift_factor_ * drift_factor_),
                    .height_sigma_m = std::nullopt};
  if (height_is_measured_) input.keyframe.height_sigma_m = drift_.height_sigma_m();
  if (!image.empty()) input.gray = loop_closure::to_gray(image);
  input.moved = std::exchange(moved_, {});
  closer_.push(std::move(input));
}

void Smoother::connect(MapFrame& news) const {
  news.T_world_body = T_graph_window_ * news.T_world_body;
  for (MapPoint& point : news.points) point.position = T_graph_window_ * point.position;
  for (Eigen::Vector3d& point : news.range_points) point = T_graph_window_ * point;
  for (StampedPose& pose : news.window) pose.T_world_body = T_graph_window_ * pose.T_world_body;
  news.corrections = closer_.corrections();
  news.graph_keyframes = closer_.pushed();
}

void Smoother::finish() {
  closer_.finish();
}

void Smoother::adjust(const std::function<void(int iteration)>& progress) {
  closer_.adjust(progress);
}

void Smoother::stop() {
  closer_.stop();
}

SE3 Smoother::T_map_odom() const {
  const SE3 T_map_graph = closer_.newest_correction();
  const std::scoped_lock lock(mutex_);
  return T_map_graph * T_graph_odom_;
}

// The pose as the odometry since a keyframe continues the corrected keyframe.
SE3 Smoother::correction(const StampedPose& pose, std::size_t keyframe) const {
  const Keyframe& k = keyframes_[keyframe];
  const loop_closure::KeyframeGraph& graph = closer().graph();
  const SE3 T_map_body = graph.T_world_known().inverse() * closer().corrected_pose(keyframe) *
                         closer().T_body_camera(keyframe).inverse() * k.T_image_body;
  return T_map_body * k.T_odom_body.inverse() * pose.T_world_body;
}

Trajectory Smoother::smoothed(const Trajectory& odometry) const {
  Trajectory out = odometry;
  const std::size_t known = std::min(keyframes_.size(), closer().graph().size());
  if (known == 0) return out;
  const auto end = stamps_.begin() + static_cast<std::ptrdiff_t>(known);
  for (StampedPose& pose : out.poses) {
    const auto after = static_cast<std::size_t>(std::upper_bound(stamps_.begin(), end, pose.stamp) -
                                                stamps_.begin());
    const std::size_t a = after == 0 ? 0 : after - 1;
    const std::size_t b = std::min(after, known - 1);
    const double span = seconds_between(stamps_[a], stamps_[b]);
    const double u = span > 0.0 ? seconds_between(stamps_[a], pose.stamp) / span : 0.0;
    pose.T_world_body = interpolate(correction(pose, a), correction(pose, b), u);
  }
  return out;
}

}  // namespace apvi::localization
