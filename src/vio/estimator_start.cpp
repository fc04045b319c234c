// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>

#include "apvi/vio/estimator.hpp"
#include "graph.hpp"
#include "window_edges.hpp"

namespace apvi::vio {
namespace {

// The first solve has farther to go than those that follow.
constexpr int kStartIterations = 20;

// A start that was refused so often comes when the vehicle accelerates, not with the next frame; an
// attempt takes longer than a frame.
constexpr int kEagerAttempts = 40;
constexpr int kFramesAnAttempt = 3;

// The newest state comes to lie at the place; what gravity says stays.
void put_at(const SE3& place, std::vector<imu::NavState>& states) {
  const SE3 T = level_alignment(place, states.back().pose());
  for (imu::NavState& state : states) state = moved(T, state);
}

}  // namespace

// Attitude, velocity and biases are known with a covariance: the window starts with one frame and
// grows, landmarks join as their rays open. Nothing is waited for.
Result Estimator::start_with_aid(const TrackedFrame& tracked, const Aid& aid) {
  aided_ = true;
  Frame& frame = push_frame(tracked.stamp, to_frame_state(aid.state), nullptr);
  window_.prior = prior_from(frame, aid, config_.start.yaw_position_sigma);
  add_sightings(window_, frame, tracked);
  Result result{.stamp = tracked.stamp, .status = Status::started, .detail = "DVL-aided"};
  estimate(result, kStartIterations);
  return result;
}

Result Estimator::start_alone(const TrackedFrame& tracked, const std::optional<SE3>& place) {
  Result result{.stamp = tracked.stamp};
  if (waiting_.empty()) start_attempts_ = 0;
  waiting_.push_back(tracked);
  const Duration span = Duration::from_seconds(config_.start.max_wait_s);
  std::erase_if(waiting_, [&](const TrackedFrame& f) { return f.stamp < tracked.stamp - span; });
  std::vector<InitFrame> frames;
  for (std::size_t k = 0; k < waiting_.size(); ++k) {
    frames.push_back({.tracked = waiting_[k], .imu = {}});
    if (k == 0) continue;
    frames.back().imu = imu_.between(waiting_[k - 1].stamp, waiting_[k].stamp);
    if (!frames.back().imu.empty()) continue;
    waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(k));
    result.detail = "inertial data without gaps";
    return result;
  }
  if (++start_attempts_ > kEagerAttempts && start_attempts_ % kFramesAnAttempt != 0) {
    result.detail = refusal_;
    return result;
  }
  InitResult found = initialize(frames, rig_.cameras.front().T_body_camera, noise_, config_.gravity,
                                config_.initializer);
  if (found.status != InitStatus::success) {
    refusal_ = fmt::format("{} ({})", to_string(found.status), found.detail);
    result.detail = refusal_;
    return result;
  }
  if (place) put_at(*place, found.states);
  adopt(waiting_, found.states);
  estimate(result, kStartIterations);
  if (const std::string why = why_diverged(result); !why.empty()) {
    window_ = empty_window(rig_);
    return {.stamp = tracked.stamp, .detail = "a start that holds (" + why + ")"};
  }
  waiting_.clear();
  result.status = Status::started;
  result.detail = fmt::format("visual-inertial ({})", found.detail);
  return result;
}

// In the dark a window knows what the aid knew when it started; the aid knows better by now.
bool Estimator::starts_anew(const TrackedFrame& tracked) const {
  if (!started() || !aided_ || has_seen_ || frozen_) return false;
  return std::ranges::none_of(tracked.observations, [this](const Observation& seen) {
    return window_.landmarks.contains(seen.id);
  });
}

// The frames of a start become keyframes, thinned out evenly to what the window holds.
void Estimator::adopt(const std::vector<TrackedFrame>& frames,
                      const std::vector<imu::NavState>& states) {
  const std::size_t room = static_cast<std::size_t>(config_.window.keyframes);
  const std::size_t count = std::min(frames.size(), room);
  for (std::size_t n = 0; n < count; ++n) {
    const std::size_t k = count == 1 ? 0 : n * (frames.size() - 1) / (count - 1);
    auto motion = n == 0 ? nullptr : preintegrate_from_newest(frames[k].stamp);
    Frame& frame = push_frame(frames[k].stamp, to_frame_state(states[k]), std::move(motion));
    add_sightings(window_, frame, frames[k]);
  }
  const Frame& first = *window_.frames.front();
  const StartConfig& c = config_.start;
  const SE3 pose = to_se3(first.state.pose.data());
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(10, 15);
  rows.block<1, 3>(0, 0) =
      (pose.rotation.conjugate() * Eigen::Vector3d::UnitZ()).transpose() / c.yaw_position_sigma;
  rows.block<3, 3>(1, 3).diagonal().setConstant(1.0 / c.yaw_position_sigma);
  rows.block<3, 3>(4, 9).diagonal().setConstant(1.0 / c.gyro_bias_sigma);
  rows.block<3, 3>(7, 12).diagonal().setConstant(1.0 / c.accel_bias_sigma);
  auto prior = make_prior(first, rows);
  // What is known of the accelerometer's bias is that it is small, not what the start made of it.
  const Eigen::Map<const Eigen::Vector3d> accel_bias(first.state.motion.data() + 6);
  prior->r.segment<3>(7) = accel_bias / c.accel_bias_sigma;
  window_.prior = std::move(prior);
}

}  // namespace apvi::vio
