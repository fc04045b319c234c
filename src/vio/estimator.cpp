// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/vio/estimator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "apvi/core/stopwatch.hpp"
#include "graph.hpp"
#include "window_edges.hpp"

namespace apvi::vio {
namespace {

// Spans of samples kept for windows that stand still or are blind for a while.
constexpr double kKeepSamplesS = 30.0;

// A preintegration is summed up anew when its biases have moved by more.
constexpr double kStaleGyroBias = 0.005;  // [rad/s]
constexpr double kStaleAccelBias = 0.05;  // [m/s²]

// Over samples that are missing the vehicle went on about as before, and nobody knows how exactly.
constexpr double kMissingSamples = 4.0;
constexpr double kLongestStep_s = 0.05;  // should the rig say too much of the sensor's rate
constexpr double kBridgedNoise = 100.0;

constexpr double kDegree = std::numbers::pi / 180.0;

// Without a window nothing is taken out at the other end.
template <typename Measurement>
void keep(std::deque<Measurement>& kept, const Measurement& measurement) {
  kept.push_back(measurement);
  const Stamp oldest = measurement.stamp - Duration::from_seconds(kKeepSamplesS);
  while (kept.front().stamp < oldest) kept.pop_front();
}

bool is_finite(const FrameState& state) {
  return Eigen::Map<const Eigen::Matrix<double, 7, 1>>(state.pose.data()).allFinite() &&
         Eigen::Map<const Eigen::Matrix<double, 9, 1>>(state.motion.data()).allFinite();
}

}  // namespace

std::string_view to_string(Status status) {
  switch (status) {
    case Status::waiting:
      return "waiting";
    case Status::started:
      return "started";
    case Status::tracking:
      return "tracking";
    case Status::blind:
      return "blind";
    case Status::frozen:
      return "frozen";
    case Status::lost:
      return "lost";
  }
  return "unknown";
}

Estimator::Estimator(const Config& config, const Rig& rig)
    : config_(config), rig_(rig), imu_(Duration::from_seconds(kKeepSamplesS)) {
  const ImuCalibration imu = rig.imu.value_or(ImuCalibration{});
  noise_ = {.gyro = imu.gyro_noise_density * config.gyro_noise_factor,
            .accel = imu.accel_noise_density * config.accel_noise_factor,
            .gyro_walk = imu.gyro_random_walk,
            .accel_walk = imu.accel_random_walk};
  if (imu.rate_hz > 0.0) {
    longest_step_s_ = std::max(kLongestStep_s, kMissingSamples / imu.rate_hz);
  }
  reset();
}

void Estimator::reset() {
  window_ = empty_window(rig_);
  waiting_.clear();
  newest_is_keyframe_ = false;
  bad_frames_ = 0;
  frozen_ = false;
  in_doubt_ = false;
  has_seen_ = false;
  aided_ = false;
  first_ping_.reset();
}

void Estimator::add(const ImuSample& sample) {
  const HealthConfig& limits = config_.health;
  const bool shock = sample.gyro.norm() > limits.max_gyro || sample.accel.norm() > limits.max_accel;
  if (!shock) imu_.add(sample);
}

void Estimator::add(const DvlMeasurement& measurement) {
  if (rig_.dvl) keep(pings_, measurement);
}

void Estimator::add(const DepthMeasurement& measurement) {
  if (config_.graph == GraphKind::tight) keep(depths_, measurement);
}

Result Estimator::process(const TrackedFrame& tracked, const std::optional<Aid>& aid,
                          const std::optional<SE3>& place) {
  const auto newest = imu_.newest();
  if (aid && starts_anew(tracked)) reset();
  Result result;
  if (!newest || *newest < tracked.stamp) {
    result = {.stamp = tracked.stamp, .detail = "inertial data"};
  } else if (started() && tracked.stamp <= window_.newest().stamp) {
    result = {.stamp = tracked.stamp, .status = Status::blind, .detail = "stamp goes backward"};
    result.state = to_nav_state(window_.newest().state);
  } else if (started()) {
    result = track(tracked, aid);
  } else {
    result = aid ? start_with_aid(tracked, *aid) : start_alone(tracked, place);
  }
  if (result.status == Status::lost) reset();
  return result;
}

Result Estimator::track(const TrackedFrame& tracked, const std::optional<Aid>& aid) {
  Result result{.stamp = tracked.stamp, .status = Status::tracking};
  if (!append(tracked)) {
    return {.stamp = tracked.stamp, .status = Status::lost, .detail = "gap in the inertial data"};
  }
  if (frozen_ && aid) lean_on(*aid);
  estimate(result, config_.window.iterations);
  if (frozen_) {
    result.status = Status::frozen;
    return result;
  }
  result.detail = why_diverged(result);
  if (!result.detail.empty()) {
    result.status = Status::lost;
    return result;
  }
  if (result.landmarks == 0) result.status = Status::blind;
  return result;
}

// Solve, tidy up, measure the information, let the window move on.
void Estimator::estimate(Result& result, int iterations) {
  triangulate(window_, config_.vision.min_parallax_deg * kDegree);
  attach_measurements();
  const Graph graph(window_, config_, rig_);
  Stopwatch watch;
  solve(graph, window_, config_, iterations);
  result.solve_s = watch.seconds();
  result.landmarks = graph.landmarks();
  has_seen_ = has_seen_ || result.landmarks > 0;
  result.sightings = graph.sightings();
  Frame& newest = window_.newest();
  if (!newest.doubtful) give_up_outliers(window_, rig_, config_.vision.max_reprojection_px);
  result.reprojection_rms_px = newest.doubtful ? 0.0 : newest_rms_px(window_, rig_);
  result.state = to_nav_state(newest.state);
  watch.reset();
  const Informations informations = newest_informations(graph, window_, config_);
  result.information = informations.absolute;
  result.window_information = informations.over_window;
  result.window_s = seconds_between(window_.frames.front()->stamp, newest.stamp);
  result.information_s = watch.seconds();
  newest_is_keyframe_ = window_.frames.size() == 1 || is_keyframe(window_, config_, rig_);
  result.keyframe = newest_is_keyframe_;
  watch.reset();
  if (newest_is_keyframe_) make_room(graph);
  result.marginalize_s = watch.seconds();
  forget_given_up(window_);
  refresh_preintegrations();
}

void Estimator::make_room(const Graph& graph) {
  const auto room = static_cast<std::size_t>(config_.window.keyframes);
  if (!frozen_) {
    if (window_.frames.size() > room) marginalize_oldest(graph, window_, config_);
    return;
  }
  const auto held = std::ranges::count_if(window_.frames, [](const auto& f) { return f->frozen; });
  if (window_.frames.size() <= static_cast<std::size_t>(held) + room) return;
  remove_frame(window_, static_cast<std::size_t>(held));
}

void Estimator::lean_on(const Aid& aid) {
  Frame& newest = window_.newest();
  newest.state = to_frame_state(aid.state);
  newest.lean = prior_from(newest, aid, config_.start.yaw_position_sigma);
}

void Estimator::freeze() {
  if (!started()) return;
  if (config_.graph == GraphKind::tight) {
    in_doubt_ = true;
    return;
  }
  frozen_ = true;
  newest_is_keyframe_ = true;
  window_.prior.reset();
  for (const auto& frame : window_.frames) frame->frozen = true;
  for (auto& [id, landmark] : window_.landmarks) landmark.frozen = landmark.triangulated();
}

void Estimator::release() {
  if (std::exchange(in_doubt_, false)) end_doubt(window_);
  if (!frozen_) return;
  frozen_ = false;
  first_ping_.reset();
  while (!window_.frames.empty() && window_.frames.front()->frozen) remove_frame(window_, 0);
  for (auto& [id, landmark] : window_.landmarks) landmark.frozen = false;
  const auto leaning =
      std::ranges::find_if(window_.frames, [](const auto& f) { return f->lean != nullptr; });
  if (leaning == window_.frames.end()) return reset();
  while (window_.frames.front() != *leaning) remove_frame(window_, 0);
  window_.prior = window_.frames.front()->lean;
  for (const auto& frame : window_.frames) frame->lean.reset();
  if (window_.frames.size() == 1) newest_is_keyframe_ = true;  // the only one must not be dropped
}

std::string Estimator::why_diverged(const Result& result) {
  const HealthConfig& limits = config_.health;
  const imu::NavState& s = result.state;
  if (!is_finite(window_.newest().state)) return "the solution is not finite";
  if (s.gyro_bias.norm() > limits.max_gyro_bias) {
    return fmt::format("gyro bias of {:.2f} rad/s", s.gyro_bias.norm());
  }
  if (s.accel_bias.norm() > limits.max_accel_bias) {
    return fmt::format("accelerometer bias of {:.2f} m/s2", s.accel_bias.norm());
  }
  if (s.v_body.norm() > limits.max_speed) return fmt::format("{:.1f} m/s", s.v_body.norm());
  bad_frames_ = result.reprojection_rms_px > limits.max_reprojection_px ? bad_frames_ + 1 : 0;
  if (bad_frames_ < limits.max_bad_frames) return {};
  return fmt::format("reprojection error of {:.1f} px in {} frames", result.reprojection_rms_px,
                     bad_frames_);
}

Frame& Estimator::push_frame(Stamp stamp, const FrameState& state,
                             std::shared_ptr<imu::Preintegration> from_previous) {
  auto frame = std::make_unique<Frame>();
  frame->stamp = stamp;
  frame->state = state;
  frame->from_previous = std::move(from_previous);
  frame->takes_pings = takes_pings(stamp);
  window_.frames.push_back(std::move(frame));
  return window_.newest();
}

bool Estimator::append(const TrackedFrame& tracked) {
  auto motion = preintegrate_from_newest(tracked.stamp);
  if (!motion) return false;
  const FrameState predicted =
      predict(window_.newest().state, *motion, rig_.gravity(config_.gravity));
  if (!newest_is_keyframe_) {
    drop_newest();
    motion = preintegrate_from_newest(tracked.stamp);
    if (!motion) return false;
  }
  Frame& frame = push_frame(tracked.stamp, predicted, std::move(motion));
  frame.doubtful = in_doubt_ && tracked.statistics.tracked < config_.tight.believed_tracks;
  add_sightings(window_, frame, tracked);
  return true;
}

void Estimator::drop_newest() {
  remove_sightings(window_, window_.newest());
  window_.frames.pop_back();
}

std::shared_ptr<imu::Preintegration> Estimator::preintegrate_from_newest(Stamp to) const {
  const Frame& newest = window_.newest();
  return preintegrate(newest.stamp, to, newest.state);
}

std::shared_ptr<imu::Preintegration> Estimator::preintegrate(Stamp from, Stamp to,
                                                             const FrameState& state) const {
  const std::vector<ImuSample> samples = imu_.between(from, to);
  if (samples.empty()) return nullptr;
  const Eigen::Map<const Eigen::Vector3d> gyro_bias(state.motion.data() + 3);
  const Eigen::Map<const Eigen::Vector3d> accel_bias(state.motion.data() + 6);
  auto sum = std::make_shared<imu::Preintegration>(noise_, gyro_bias, accel_bias);
  for (std::size_t k = 1; k < samples.size(); ++k) {
    const bool bridged = seconds_between(samples[k - 1].stamp, samples[k].stamp) > longest_step_s_;
    sum->integrate(samples[k - 1], samples[k], bridged ? kBridgedNoise : 1.0);
  }
  return sum;
}

// First-order bias correction holds for small changes only.
void Estimator::refresh_preintegrations() {
  for (std::size_t k = 1; k < window_.frames.size(); ++k) {
    const Frame& before = *window_.frames[k - 1];
    Frame& frame = *window_.frames[k];
    const Eigen::Map<const Eigen::Vector3d> gyro_bias(before.state.motion.data() + 3);
    const Eigen::Map<const Eigen::Vector3d> accel_bias(before.state.motion.data() + 6);
    if (!frame.from_previous) continue;
    const imu::Preintegration& sum = *frame.from_previous;
    if ((sum.gyro_bias() - gyro_bias).norm() < kStaleGyroBias &&
        (sum.accel_bias() - accel_bias).norm() < kStaleAccelBias) {
      continue;
    }
    if (auto anew = preintegrate(before.stamp, frame.stamp, before.state)) {
      frame.from_previous = std::move(anew);
    }
  }
}

// DVL in the paper's graph: only while the aid supplies the poses, and so long after it that the
// window knows its speed as well as the aid does.
bool Estimator::takes_pings(Stamp stamp) const {
  if (!rig_.dvl) return false;
  if (config_.graph == GraphKind::tight) return config_.tight.velocity;
  if (frozen_) return true;
  return aided_ && (!first_ping_ || seconds_between(*first_ping_, stamp) < config_.start.dvl_s);
}

void Estimator::attach_measurements() {
  const Stamp oldest = window_.frames.front()->stamp;
  // Not in order: the filter that puts them on the true clock changes its mind.
  std::erase_if(pings_, [&](const DvlMeasurement& ping) { return ping.stamp < oldest; });
  while (depths_.size() > 1 && depths_[1].stamp < oldest) depths_.pop_front();
  for (const DvlMeasurement& ping : pings_) {
    const auto after =
        std::upper_bound(window_.frames.begin(), window_.frames.end(), ping.stamp,
                         [](Stamp stamp, const auto& frame) { return stamp < frame->stamp; });
    attach(**std::prev(after), ping);
  }
  if (config_.graph != GraphKind::tight || !config_.tight.depth) return;
  for (const auto& frame : window_.frames) attach_depth(*frame);
}

// Depth is measured from wherever the window started: tide, atmosphere and the sensor's zero are
// nobody's concern here.
void Estimator::attach_depth(Frame& frame) {
  const auto measured = depth_at(frame, depths_, rig_.depth_sign());
  if (!measured || (frame.depth && frame.depth->stamp == measured->stamp)) return;
  if (!window_.depth_zero_m) {
    const SE3 pose = to_se3(frame.state.pose.data());
    window_.depth_zero_m = measured->depth_m - rig_.depth_sign() * (pose * depth_lever(rig_)).z();
  }
  frame.depth = measured;
}

void Estimator::attach(Frame& frame, const DvlMeasurement& measured) {
  if (!frame.takes_pings) return;
  const auto same = [&](const Frame::Ping& p) { return p.measured.stamp == measured.stamp; };
  if (std::any_of(frame.pings.begin(), frame.pings.end(), same)) return;
  const auto motion = preintegrate(frame.stamp, measured.stamp, frame.state);
  const auto sample = imu_.at(measured.stamp);
  if (!motion || !sample) return;
  frame.pings.push_back({measured, ping_factor(measured, motion, sample->gyro, rig_)});
  if (!first_ping_ && !frozen_) first_ping_ = measured.stamp;
}

}  // namespace apvi::vio
