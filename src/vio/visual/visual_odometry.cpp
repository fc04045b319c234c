// SPDX-License-Identifier: BSD-3-Clause
#include "vio/visual/visual_odometry.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "core/stopwatch.hpp"
#include "vio/state_prior.hpp"
#include "vio/visual/resection.hpp"
#include "vio/visual/visual_start.hpp"
#include "vio/window/window_solution.hpp"
#include "vio/window/window_update.hpp"

namespace apvi::vio {
namespace {

constexpr int kStartIterations = 20;

// A start is attempted at every n-th frame that waits, as it takes longer than a frame.
constexpr int kFramesPerAttempt = 3;

// Prior of the start: rotation [rad] and position [start distances] of the first pose, and the
// distance to the last one, relative.
constexpr double kGaugeSigma = 1e-4;

// Minimum number of points that a frame shares with the window.
constexpr std::size_t kMinPoints = 10;

// Specific force that defines the vertical without an IMU, see the class.
Eigen::Vector3d assumed_force(const Rig& rig) {
  const SE3& T = rig.cameras.front().T_body_camera;
  if (so3::angle_between(T.rotation, Eigen::Quaterniond::Identity()) < 1e-9) {
    return {0.0, -kStandardGravity, 0.0};  // y of a camera is down
  }
  return -rig.gravity(kStandardGravity);
}

void move(Window& window, const SE3& T) {
  for (const auto& frame : window.frames) {
    frame->state.pose = to_block(T * to_se3(frame->state.pose.data()));
  }
}

// Holds the first pose of the window, and the distance from it to the last one.
std::shared_ptr<Prior> gauge_prior(const Window& window, double distance) {
  const Frame& first = *window.frames.front();
  const Frame& last = window.newest();
  const Eigen::Vector3d path =
      to_se3(last.state.pose.data()).translation - to_se3(first.state.pose.data()).translation;
  const Eigen::Vector3d row = path / (path.squaredNorm() * kGaugeSigma);
  auto prior = std::make_shared<Prior>();
  for (const Frame* frame : {&first, &last}) {
    auto* pose = const_cast<double*>(frame->state.pose.data());
    prior->kept.push_back({{pose, kPoseSize}, {pose, pose + kPoseSize}});
  }
  prior->J = Eigen::MatrixXd::Zero(7, 12);
  prior->J.diagonal().head<3>().setConstant(1.0 / kGaugeSigma);
  prior->J.diagonal().segment<3>(3).setConstant(1.0 / (kGaugeSigma * distance));
  prior->J.block<1, 3>(6, 3) = -row.transpose();
  prior->J.block<1, 3>(6, 9) = row.transpose();
  prior->r = Eigen::VectorXd::Zero(7);
  return prior;
}

Config adapted(Config config) {
  config.calibration = CalibrationConfig::fixed();
  // Without inertial terms, the newest frame hangs on landmarks with older observations.
  config.window.continuing_tracks = ContinuingTracks::reanchor;
  return config;
}

}  // namespace

VisualOdometry::VisualOdometry(const Config& config, const Rig& rig)
    : config_(adapted(config)),
      rig_(rig),
      p_body_camera_(rig.cameras.front().T_body_camera.translation),
      scene_depth_(config.visual.start_distance) {
  reset();
}

void VisualOdometry::reset() {
  window_ = empty_window(rig_);
  waiting_.clear();
  mean_force_.clear();
  attempts_ = 0;
  bad_.reset();
  newest_is_keyframe_ = false;
}

void VisualOdometry::follow(const Window& metric) {
  if (started() || !waiting_.empty()) reset();
  is_metric_ = true;
  if (const double depth = median_depth(metric); depth > 0.0) scene_depth_ = depth;
}

void VisualOdometry::change_scale(const ScaleChange& to_meters) {
  is_metric_ = true;
  scene_depth_ *= to_meters.scale;
  const auto change = [&](PoseBlock& pose) {
    pose = to_block(apvi::changed(to_meters, to_se3(pose.data()), p_body_camera_));
  };
  for (const auto& frame : window_.frames) {
    change(frame->state.pose);
    if (frame->first.pose) change(*frame->first.pose);
  }
  for (auto& [id, landmark] : window_.landmarks) landmark.inverse_depth /= to_meters.scale;
  if (window_.prior) window_.prior = changed(*window_.prior, to_meters);
}

// Of poses only: landmarks that go on are re-anchored. With the lever arm l of the camera, position
// p' = s p + (s - 1) R l, so δp = (δp' + (s - 1) R [l]x δθ) / s.
std::shared_ptr<const Prior> VisualOdometry::changed(const Prior& prior,
                                                     const ScaleChange& to_meters) const {
  auto out = std::make_shared<Prior>(prior);
  for (std::size_t k = 0; k < out->kept.size(); ++k) {
    Prior::Kept& kept = out->kept[k];
    const SE3 pose = to_se3(kept.value.data());
    const SE3 after = apvi::changed(to_meters, pose, p_body_camera_);
    Eigen::Map<Eigen::Vector3d>(kept.value.data()) = after.translation;
    const auto column = static_cast<Eigen::Index>(kPoseTangent * k);
    auto by_position = out->J.middleCols<3>(column + 3);
    by_position /= to_meters.scale;
    const Eigen::Matrix3d turn = pose.rotation.toRotationMatrix() * so3::hat(p_body_camera_);
    out->J.middleCols<3>(column) += (to_meters.scale - 1.0) * by_position * turn;
  }
  return out;
}

void VisualOdometry::add(const ImuSample& sample) {
  force_sum_ += sample.accel;
  ++force_count_;
}

Result VisualOdometry::process(const TrackedFrame& tracked, const std::optional<SE3>& last_pose) {
  const auto nothing = [&](const char* detail) {
    return Result{.stamp = tracked.stamp, .detail = detail, .up_to_scale = !is_metric_};
  };
  if (tracked.observations.empty()) return nothing("images with corners");
  if (started() && tracked.stamp <= window_.newest().stamp) return nothing("newer images");
  Result result = started() ? track(tracked) : start(tracked, last_pose);
  result.up_to_scale = !is_metric_;
  if (result.status == Status::lost) reset();
  force_sum_.setZero();
  force_count_ = 0;
  return result;
}

void VisualOdometry::forget_old_frames(Stamp newest) {
  const Stamp oldest = newest - Duration::from_seconds(config_.visual.lookback_s);
  std::size_t old = 0;
  while (waiting_[old].stamp < oldest) ++old;
  waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(old));
  mean_force_.erase(mean_force_.begin(), mean_force_.begin() + static_cast<std::ptrdiff_t>(old));
}

void VisualOdometry::collect(const TrackedFrame& tracked) {
  waiting_.push_back(tracked);
  mean_force_.emplace_back(force_sum_ / std::max(force_count_, 1));
  forget_old_frames(tracked.stamp);
}

Result VisualOdometry::start(const TrackedFrame& tracked, const std::optional<SE3>& last_pose) {
  Result result{.stamp = tracked.stamp};
  collect(tracked);
  const bool attempt = ++attempts_ % kFramesPerAttempt == 0;
  auto found = attempt ? start_visually(waiting_, config_, rig_, waiting_for_) : std::nullopt;
  result.detail = waiting_for_;
  if (!found) return result;
  begin(*std::move(found), last_pose, result);
  waiting_.clear();
  mean_force_.clear();
  return result;
}

// Continues in the unit so far, level, and at the last pose.
void VisualOdometry::begin(VisualStart found, const std::optional<SE3>& last_pose, Result& result) {
  const double unit = scene_depth_ / config_.visual.start_distance;
  const Eigen::Vector3d force = up_force(found.T_world_body);
  SE3 T{so3::level_attitude(force, rig_.gravity(kStandardGravity)), Eigen::Vector3d::Zero()};
  window_ = std::move(found.window);
  scale_lengths(window_, unit);
  const SE3 newest = T * to_se3(window_.newest().state.pose.data());
  const Eigen::Vector3d first = to_se3(window_.frames.front()->state.pose.data()).translation;
  T.translation = -(T * first);
  if (last_pose) T = level_alignment(*last_pose, newest) * SE3{T.rotation, Eigen::Vector3d::Zero()};
  move(window_, T);
  window_.prior = gauge_prior(window_, scene_depth_);
  for (std::size_t i = 0; i + 1 < waiting_.size(); ++i) {
    if (!found.T_world_body[i]) continue;
    const SE3 pose = apvi::changed({.scale = unit}, *found.T_world_body[i], p_body_camera_);
    result.earlier.push_back({waiting_[i].stamp, T * pose});
  }
  finish(result, kStartIterations);
  newest_is_keyframe_ = true;  // the prior refers to it
  result.status = Status::started;
  result.detail = "images alone, up to scale";
}

// Mean specific force in the frame of the first pose of the window.
Eigen::Vector3d VisualOdometry::up_force(const std::vector<std::optional<SE3>>& poses) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (poses[i]) sum += poses[i]->rotation * mean_force_[i];
  }
  return sum.norm() > 0.0 ? sum : assumed_force(rig_);
}

Result VisualOdometry::track(const TrackedFrame& tracked) {
  Result result{.stamp = tracked.stamp, .status = Status::tracking};
  const double focal = rig_.cameras.front().model.parameters().fx;
  const auto camera = resect(tracked, landmark_positions(window_),
                             config_.vision.max_reprojection_px / focal, kMinPoints);
  if (!camera) {
    const double silent_s = seconds_between(window_.newest().stamp, tracked.stamp);
    const bool lost = silent_s > config_.visual.max_gap_s;
    return {.stamp = tracked.stamp,
            .status = lost ? Status::lost : Status::waiting,
            .detail = "too few corners of the scene are seen again"};
  }
  if (!newest_is_keyframe_) {
    remove_observations(window_, window_.newest());
    window_.frames.pop_back();
  }
  add_frame(window_, tracked, *camera * rig_.cameras.front().T_body_camera.inverse());
  finish(result, config_.window.max_iterations);
  const bool bad = result.reprojection_rms_px > config_.health.max_reprojection_px;
  const std::optional<double> bad_s = bad_.update(tracked.stamp, bad);
  if (!bad_s || *bad_s < config_.health.max_bad_s) return result;
  result.status = Status::lost;
  result.detail = fmt::format("reprojection error of {:.1f} px for {:.1f} s",
                              result.reprojection_rms_px, *bad_s);
  return result;
}

// One update of the window.
void VisualOdometry::finish(Result& result, int iterations) {
  triangulate(window_, config_.vision.min_parallax_deg * kRadiansPerDegree);
  const Graph graph(window_, config_, rig_);
  solve_window(graph, window_, config_, rig_, iterations, result);
  newest_is_keyframe_ = result.keyframe;
  const Stopwatch watch;
  const auto room = static_cast<std::size_t>(config_.window.keyframes);
  if (newest_is_keyframe_ && window_.frames.size() > room) {
    marginalize_oldest(graph, window_, config_);
  }
  result.marginalize_s = watch.seconds();
  remove_rejected(window_);
  if (const double depth = median_depth(window_); depth > 0.0) scene_depth_ = depth;
}

}  // namespace apvi::vio
