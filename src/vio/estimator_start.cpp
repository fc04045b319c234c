// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>

#include "vio/estimator.hpp"
#include "vio/initialization/initializer.hpp"
#include "vio/window/graph.hpp"
#include "vio/window/window_update.hpp"

namespace apvi::vio {
namespace {

// The first solve starts farther from the optimum than later ones.
constexpr int kStartIterations = 20;

// After many failures an attempt is made every few frames only, as it takes longer than a frame;
// initialization then succeeds when the vehicle accelerates.
constexpr int kMaxConsecutiveAttempts = 40;
constexpr int kFramesPerAttempt = 3;

// Aligns the newest state with the pose in position and heading; roll and pitch from gravity are
// kept.
void align_to(const SE3& start_pose, std::vector<imu::NavState>& states) {
  const SE3 T = level_alignment(start_pose, states.back().pose());
  for (imu::NavState& state : states) state = transformed(T, state);
}

}  // namespace

// The state prior gives attitude, velocity and biases with a covariance: the window starts with one
// frame, and landmarks are added as their parallax grows.
Result Estimator::start_with_prior(const TrackedFrame& tracked, const StatePrior& at_image) {
  const StatePrior prior = at_state_stamp(at_image, tracked.stamp);
  started_with_prior_ = true;
  Frame& frame = push_frame(tracked.stamp, to_frame_state(prior.state), nullptr);
  window_.prior =
      with_calibration(make_state_prior(frame, prior, config_.initialization.gauge_sigma));
  add_observations(window_, frame, tracked);
  Result result{.stamp = tracked.stamp, .status = Status::started, .detail = "DVL-aided"};
  estimate(result, kStartIterations);
  return result;
}

Result Estimator::start_alone(const TrackedFrame& tracked, const std::optional<SE3>& start_pose) {
  Result result{.stamp = tracked.stamp};
  if (waiting_.empty()) start_attempts_ = 0;
  waiting_.push_back(tracked);
  const Duration span = Duration::from_seconds(config_.initialization.lookback_s);
  std::erase_if(waiting_, [&](const TrackedFrame& f) { return f.stamp < tracked.stamp - span; });
  std::vector<InitFrame> frames;
  for (std::size_t k = 0; k < waiting_.size(); ++k) {
    frames.push_back({.tracked = waiting_[k], .imu = {}});
    frames.back().tracked.stamp = state_stamp(waiting_[k].stamp);
    if (k == 0) continue;
    frames.back().imu = imu_.between(frames[k - 1].tracked.stamp, frames[k].tracked.stamp);
    if (!frames.back().imu.empty()) continue;
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(k));
    result.detail = "inertial data without gaps";
    return result;
  }
  if (++start_attempts_ > kMaxConsecutiveAttempts && start_attempts_ % kFramesPerAttempt != 0) {
    result.detail = last_init_failure_;
    return result;
  }
  const InitCamera camera{to_se3(window_.calibration.T_body_camera.front().data()),
                          rig_.cameras.front().model.parameters().fx};
  InitResult found =
      initialize(frames, camera, noise_, config_.gravity, config_.initialization_without_dvl);
  if (found.status != InitStatus::success) {
    last_init_failure_ = fmt::format("{} ({})", to_string(found.status), found.detail);
    result.detail = last_init_failure_;
    return result;
  }
  if (start_pose) align_to(*start_pose, found.states);
  for (std::size_t k = 0; k + 1 < waiting_.size(); ++k) {
    const FrameState state = to_frame_state(found.states[k]);
    result.earlier.push_back({waiting_[k].stamp, at_image_stamp(state, waiting_[k].stamp).pose()});
  }
  insert_start_frames(waiting_, found.states);
  estimate(result, kStartIterations);
  if (const std::string reason = divergence_reason(result); !reason.empty()) {
    clear_window();
    return {.stamp = tracked.stamp, .detail = "a valid initialization (" + reason + ")"};
  }
  waiting_.clear();
  result.status = Status::started;
  result.detail = fmt::format("visual-inertial ({})", found.detail);
  return result;
}

// The vertical does not change, so the prior's Jacobian stays as it is.
void Estimator::shift(const Eigen::Vector3d& offset) {
  const auto move = [&](double* pose) { Eigen::Map<Eigen::Vector3d>(pose) += offset; };
  std::vector<const double*> poses;
  for (const auto& frame : window_.frames) {
    move(frame->state.pose.data());
    if (frame->first.pose) move(frame->first.pose->data());
    poses.push_back(frame->state.pose.data());
  }
  if (!window_.prior) return;
  auto prior = std::make_shared<Prior>(*window_.prior);
  for (Prior::Kept& kept : prior->kept) {
    if (std::ranges::find(poses, kept.block.data) != poses.end()) move(kept.value.data());
  }
  window_.prior = std::move(prior);
  if (window_.depth_zero_m) *window_.depth_zero_m -= rig_.down_sign() * offset.z();
}

// Without landmarks the window only propagates its initial state prior; the current state prior is
// more accurate.
bool Estimator::should_restart(const TrackedFrame& tracked) const {
  if (!started() || !started_with_prior_ || has_used_landmarks_ || frozen_) return false;
  return std::ranges::none_of(tracked.observations, [this](const FeatureObservation& seen) {
    return window_.landmarks.contains(seen.id);
  });
}

// The frames of the initialization become keyframes, thinned evenly to the window size.
void Estimator::insert_start_frames(const std::vector<TrackedFrame>& frames,
                                    const std::vector<imu::NavState>& states) {
  const std::size_t room = static_cast<std::size_t>(config_.window.keyframes);
  const std::size_t count = std::min(frames.size(), room);
  for (std::size_t n = 0; n < count; ++n) {
    const std::size_t k = count == 1 ? 0 : n * (frames.size() - 1) / (count - 1);
    auto motion = n == 0 ? nullptr : preintegrate_from_newest(state_stamp(frames[k].stamp));
    Frame& frame = push_frame(frames[k].stamp, to_frame_state(states[k]), std::move(motion));
    add_observations(window_, frame, frames[k]);
  }
  const Frame& first = *window_.frames.front();
  const StartConfig& c = config_.initialization;
  const SE3 pose = to_se3(first.state.pose.data());
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(10, 15);
  rows.block<1, 3>(0, 0) =
      (pose.rotation.conjugate() * Eigen::Vector3d::UnitZ()).transpose() / c.gauge_sigma;
  rows.block<3, 3>(1, 3).diagonal().setConstant(1.0 / c.gauge_sigma);
  rows.block<3, 3>(4, 9).diagonal().setConstant(1.0 / c.gyro_bias_sigma);
  rows.block<3, 3>(7, 12).diagonal().setConstant(1.0 / c.accel_bias_sigma);
  auto prior = make_prior(first, rows);
  // The accelerometer bias prior has zero mean, not the initial estimate.
  const Eigen::Map<const Eigen::Vector3d> accel_bias(first.state.motion.data() + 6);
  prior->r.segment<3>(7) = accel_bias / c.accel_bias_sigma;
  window_.prior = with_calibration(prior);
}

}  // namespace apvi::vio
