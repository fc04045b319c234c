// SPDX-License-Identifier: BSD-3-Clause
#include "vio/estimator.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "core/stopwatch.hpp"
#include "vio/window/graph.hpp"
#include "vio/window/window_solution.hpp"
#include "vio/window/window_update.hpp"

namespace apvi::vio {
namespace {

// History of samples, for frozen windows and short gaps [s].
constexpr double kSampleHistory_s = 30.0;

// A preintegration is repeated when its biases have changed by more than this.
constexpr double kStaleGyroBias = 0.005;  // [rad/s]
constexpr double kStaleAccelBias = 0.05;  // [m/s²]

// Frames are dated by the estimated time offset of the camera when it differs by more than this,
// and by at most this fraction of the time since the last frame.
constexpr double kMinOffsetStep_s = 0.002;
constexpr double kMaxOffsetStep = 0.25;

// A step longer than this many sample periods is a gap in the inertial data.
constexpr double kMissingSamples = 4.0;
constexpr double kMinMaxStep_s =
    0.05;  // lower limit, in case the nominal rate of the rig is too high

// Appends a measurement and drops those older than the history; nothing else removes them before
// initialization.
template <typename Measurement>
void keep(std::deque<Measurement>& kept, const Measurement& measurement) {
  kept.push_back(measurement);
  const Stamp oldest = measurement.stamp - Duration::from_seconds(kSampleHistory_s);
  while (kept.front().stamp < oldest) kept.pop_front();
}

bool is_finite(const FrameState& state) {
  return Eigen::Map<const Eigen::Matrix<double, 7, 1>>(state.pose.data()).allFinite() &&
         Eigen::Map<const Eigen::Matrix<double, 9, 1>>(state.motion.data()).allFinite();
}

}  // namespace

Estimator::Estimator(const Config& config, const Rig& rig)
    : config_(config),
      rig_(rig),
      imu_(Duration::from_seconds(kSampleHistory_s)),
      window_(empty_window(rig)),
      calibration_blocks_(blocks(window_.calibration, config.calibration)),
      calibration_memory_(window_.calibration, config.calibration),
      calibration_hold_(window_.calibration, config.calibration, rig) {
  window_.calibration_hold = calibration_hold_.prior();
  const ImuCalibration imu = rig.imu.value_or(ImuCalibration{});
  noise_ = {.gyro = imu.gyro_noise_density * config.gyro_noise_factor,
            .accel = imu.accel_noise_density * config.accel_noise_factor,
            .gyro_walk = imu.gyro_random_walk,
            .accel_walk = imu.accel_random_walk};
  if (imu.rate_hz > 0.0) {
    max_step_s_ = std::max(kMinMaxStep_s, kMissingSamples / imu.rate_hz);
  }
}

// The calibration blocks stay where they are, since priors refer to them.
void Estimator::clear_window() {
  calibration_memory_.restore(window_.calibration);
  window_.frames.clear();
  window_.landmarks.clear();
  window_.rejected_tracks.clear();
  window_.prior.reset();
  window_.depth_zero_m.reset();
}

void Estimator::reset() {
  clear_window();
  waiting_.clear();
  newest_is_keyframe_ = false;
  bad_.reset();
  frozen_ = false;
  prior_before_freeze_.reset();
  vision_failed_ = false;
  has_used_landmarks_ = false;
  started_with_prior_ = false;
  first_ping_.reset();
}

void Estimator::add(const ImuSample& sample) {
  const HealthConfig& limits = config_.health;
  const bool saturated =
      sample.gyro.norm() > limits.max_gyro || sample.accel.norm() > limits.max_accel;
  if (!saturated) imu_.add(sample);
}

void Estimator::add(const DvlMeasurement& measurement) {
  if (rig_.dvl) keep(pings_, measurement);
}

void Estimator::add(const PressureDepthMeasurement& measurement) {
  if (config_.graph == GraphKind::tight) keep(depths_, measurement);
}

Result Estimator::process(const TrackedFrame& tracked, const std::optional<StatePrior>& prior,
                          const std::optional<SE3>& start_pose) {
  const auto newest = imu_.newest();
  follow_time_offset(tracked.stamp);
  if (prior && should_restart(tracked)) reset();
  Result result;
  if (!newest || *newest < tracked.stamp) {
    result = {.stamp = tracked.stamp, .detail = "inertial data"};
  } else if (started() && tracked.stamp <= window_.newest().image_stamp) {
    result = {.stamp = tracked.stamp,
              .status = Status::blind,
              .detail = "stamp is not newer than the last frame"};
    result.state = to_nav_state(window_.newest().state);
  } else if (started()) {
    result = track(tracked, prior);
  } else {
    result = prior ? start_with_prior(tracked, *prior) : start_alone(tracked, start_pose);
  }
  if (result.status == Status::lost) reset();
  return result;
}

Result Estimator::track(const TrackedFrame& tracked, const std::optional<StatePrior>& prior) {
  Result result{.stamp = tracked.stamp, .status = Status::tracking};
  if (!append(tracked)) {
    return {.stamp = tracked.stamp, .status = Status::lost, .detail = "gap in the inertial data"};
  }
  if (frozen_ && prior) use_prior(at_state_stamp(*prior, tracked.stamp));
  estimate(result, config_.window.max_iterations);
  if (frozen_) {
    result.status = Status::frozen;
    return result;
  }
  result.detail = divergence_reason(result);
  if (!result.detail.empty()) {
    result.status = Status::lost;
    return result;
  }
  if (result.landmarks == 0) result.status = Status::blind;
  return result;
}

// One update of the window: solve, reject outliers, compute the information, marginalize.
void Estimator::estimate(Result& result, int iterations) {
  triangulate(window_, config_.vision.min_parallax_deg * kRadiansPerDegree);
  attach_measurements();
  const Graph graph(window_, config_, rig_);
  solve_window(graph, window_, config_, rig_, iterations, result);
  has_used_landmarks_ = has_used_landmarks_ || result.landmarks > 0;
  newest_is_keyframe_ = result.keyframe;
  Stopwatch watch;
  if (newest_is_keyframe_ && !frozen_) release_calibration(graph);
  if (newest_is_keyframe_) limit_window(graph);
  if (!frozen_) {
    calibration_memory_.update(result.stamp, window_.prior, window_.calibration,
                               calibration_blocks_);
  }
  result.marginalize_s = watch.seconds();
  if (window_.newest().motion.compensated_s != 0.0) {
    result.state = at_image_stamp(window_.newest().state, result.stamp);
  }
  remove_rejected(window_);
  refresh_preintegrations();
}

// Parameters of the rig that the measurements contradict are estimated from now on.
void Estimator::release_calibration(const Graph& graph) {
  if (!calibration_hold_.holds_any()) return;
  const Prior known = calibration_knowledge(graph, window_, config_);
  if (known.kept.empty()) return;
  calibration_hold_.update(
      estimate_of(window_.calibration, rig_, config_.calibration, known).parameters);
  window_.calibration_hold = calibration_hold_.prior();
}

void Estimator::limit_window(const Graph& graph) {
  const auto room = static_cast<std::size_t>(config_.window.keyframes);
  if (!frozen_) {
    if (window_.frames.size() > room) marginalize_oldest(graph, window_, config_);
    return;
  }
  const auto held = std::ranges::count_if(window_.frames, [](const auto& f) { return f->frozen; });
  if (window_.frames.size() <= static_cast<std::size_t>(held) + room) return;
  remove_frame(window_, static_cast<std::size_t>(held));
}

void Estimator::use_prior(const StatePrior& prior) {
  Frame& newest = window_.newest();
  newest.state = to_frame_state(prior.state);
  newest.state_prior = make_state_prior(newest, prior, config_.initialization.gauge_sigma);
}

void Estimator::freeze() {
  if (!started()) return;
  if (config_.graph == GraphKind::tight) {
    vision_failed_ = true;
    return;
  }
  frozen_ = true;
  newest_is_keyframe_ = true;
  prior_before_freeze_ = std::exchange(window_.prior, nullptr);
  for (const auto& frame : window_.frames) frame->frozen = true;
  for (auto& [id, landmark] : window_.landmarks) landmark.frozen = landmark.triangulated();
}

// With a tight graph, releasing and unfreezing are the same: no frame is frozen.
bool Estimator::end_freeze() {
  if (std::exchange(vision_failed_, false)) restore_excluded_frames(window_);
  if (!std::exchange(frozen_, false)) return false;
  first_ping_.reset();
  return true;
}

void Estimator::unfreeze() {
  if (!end_freeze()) return;
  for (auto& [id, landmark] : window_.landmarks) landmark.frozen = false;
  for (const auto& frame : window_.frames) {
    // Poses of DIPO share its drift: each of them after the first adds nothing.
    if (frame->from_previous) frame->state_prior.reset();
    frame->frozen = false;
  }
  window_.prior = std::exchange(prior_before_freeze_, nullptr);
  shrink_to_size();
}

// A freeze adds as many frames as the window has.
void Estimator::shrink_to_size() {
  const auto room = static_cast<std::size_t>(config_.window.keyframes);
  while (window_.frames.size() > room) {
    newest_is_keyframe_ = true;  // the prior may refer to it
    marginalize_oldest(Graph(window_, config_, rig_), window_, config_);
  }
}

void Estimator::release() {
  if (!end_freeze()) return;
  prior_before_freeze_.reset();
  while (!window_.frames.empty() && window_.frames.front()->frozen) remove_frame(window_, 0);
  for (auto& [id, landmark] : window_.landmarks) landmark.frozen = false;
  const auto first_with_prior =
      std::ranges::find_if(window_.frames, [](const auto& f) { return f->state_prior != nullptr; });
  if (first_with_prior == window_.frames.end()) return reset();
  while (window_.frames.front() != *first_with_prior) remove_frame(window_, 0);
  window_.prior = with_calibration(window_.frames.front()->state_prior);
  for (const auto& frame : window_.frames) frame->state_prior.reset();
  if (window_.frames.size() == 1) newest_is_keyframe_ = true;  // the only frame must not be dropped
}

std::shared_ptr<const Prior> Estimator::with_calibration(
    const std::shared_ptr<const Prior>& prior) {
  calibration_memory_.restore(window_.calibration);
  return std::make_shared<Prior>(joined(*prior, calibration_memory_.knowledge()));
}

CalibrationEstimate Estimator::calibration() const {
  const Prior known = calibration_part(window_.prior, calibration_blocks_);
  CalibrationEstimate found =
      estimate_of(window_.calibration, rig_, config_.calibration,
                  known.kept.empty() ? calibration_memory_.knowledge() : known);
  for (CalibrationParameter& p : found.parameters) p.held = calibration_hold_.holds(p.name);
  return found;
}

// In small steps, so that frames stay in order. An image before its stamp is left to the window, as
// inertial data have not reached it.
void Estimator::follow_time_offset(Stamp image_stamp) {
  if (!started() || !config_.calibration.camera_time_offset.estimate) return;
  const double missing = window_.calibration.camera_time_offset_s - compensated_s_;
  if (std::abs(missing) < kMinOffsetStep_s) return;
  const double interval = seconds_between(window_.newest().image_stamp, image_stamp);
  const double limit = kMaxOffsetStep * std::max(0.0, interval);
  compensated_s_ = std::max(0.0, compensated_s_ + std::clamp(missing, -limit, limit));
}

Stamp Estimator::state_stamp(Stamp image_stamp) const {
  return image_stamp - Duration::from_seconds(compensated_s_);
}

// At constant velocity and rate, backward over a fraction of a second.
StatePrior Estimator::at_state_stamp(StatePrior prior, Stamp image_stamp) const {
  const std::vector<ImuSample> samples = imu_.between(state_stamp(image_stamp), image_stamp);
  if (compensated_s_ == 0.0 || samples.empty()) return prior;
  Eigen::Vector3d rate = -prior.state.gyro_bias;
  for (const ImuSample& s : samples) rate += s.gyro / static_cast<double>(samples.size());
  imu::NavState& state = prior.state;
  state.p_world -= compensated_s_ * (state.R_world_body * state.v_body);
  const Eigen::Quaterniond back = so3::exp(-compensated_s_ * rate);
  state.R_world_body = (state.R_world_body * back).normalized();
  state.v_body = back.conjugate() * state.v_body;
  return prior;
}

imu::NavState Estimator::at_image_stamp(const FrameState& state, Stamp image_stamp) const {
  if (compensated_s_ == 0.0) return to_nav_state(state);
  const auto motion = preintegrate(state_stamp(image_stamp), image_stamp, state);
  if (!motion) return to_nav_state(state);
  return to_nav_state(predict(state, *motion, rig_.gravity(config_.gravity)));
}

std::string Estimator::divergence_reason(const Result& result) {
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
  const bool bad = result.reprojection_rms_px > limits.max_reprojection_px;
  const std::optional<double> bad_s = bad_.update(result.stamp, bad);
  if (!bad_s || *bad_s < limits.max_bad_s) return {};
  return fmt::format("reprojection error of {:.1f} px for {:.1f} s", result.reprojection_rms_px,
                     *bad_s);
}

Frame& Estimator::push_frame(Stamp image_stamp, const FrameState& state,
                             std::shared_ptr<imu::Preintegration> from_previous) {
  auto frame = std::make_unique<Frame>();
  frame->stamp = state_stamp(image_stamp);
  frame->image_stamp = image_stamp;
  frame->state = state;
  frame->motion.compensated_s = compensated_s_;
  if (const auto sample = imu_.at(frame->stamp)) {
    const imu::NavState nav = to_nav_state(state);
    frame->motion.rate = sample->gyro - nav.gyro_bias;
    frame->motion.velocity = nav.v_body;
  }
  frame->from_previous = std::move(from_previous);
  frame->uses_pings = uses_pings(frame->stamp);
  window_.frames.push_back(std::move(frame));
  return window_.newest();
}

bool Estimator::append(const TrackedFrame& tracked) {
  const Stamp stamp = state_stamp(tracked.stamp);
  auto motion = preintegrate_from_newest(stamp);
  if (!motion) return false;
  const FrameState predicted =
      predict(window_.newest().state, *motion, rig_.gravity(config_.gravity));
  if (!newest_is_keyframe_) {
    drop_newest();
    motion = preintegrate_from_newest(stamp);
    if (!motion) return false;
  }
  Frame& frame = push_frame(tracked.stamp, predicted, std::move(motion));
  frame.vision_excluded =
      vision_failed_ && tracked.statistics.tracked < config_.tight.recovery_min_tracks;
  add_observations(window_, frame, tracked);
  return true;
}

void Estimator::drop_newest() {
  remove_observations(window_, window_.newest());
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
    // Not the time between these two: the first and the last may be interpolated within a gap.
    const double step_s = imu_.step_at(samples[k - 1].stamp);
    sum->integrate(samples[k - 1], samples[k], step_s > max_step_s_ ? step_s : 0.0);
  }
  return sum;
}

// The first-order bias correction is accurate for small changes only.
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
    if (auto updated = preintegrate(before.stamp, frame.stamp, before.state)) {
      frame.from_previous = std::move(updated);
    }
  }
}

// With `graph: paper`, DVL pings are used while the window is frozen and for some time afterwards
// or after initialization, until the velocity is observable without them.
bool Estimator::uses_pings(Stamp stamp) const {
  if (!rig_.dvl) return false;
  if (config_.graph == GraphKind::tight) return config_.tight.use_dvl_velocity;
  if (config_.initialization.dvl_aiding_s == 0.0) return false;
  if (frozen_) return true;
  return started_with_prior_ && (!first_ping_ || seconds_between(*first_ping_, stamp) <
                                                     config_.initialization.dvl_aiding_s);
}

void Estimator::attach_measurements() {
  const Stamp oldest = window_.frames.front()->stamp;
  // Not sorted: the time offset estimate changes over time.
  std::erase_if(pings_, [&](const DvlMeasurement& ping) { return ping.stamp < oldest; });
  while (depths_.size() > 1 && depths_[1].stamp < oldest) depths_.pop_front();
  for (DvlMeasurement& ping : pings_) {
    const auto after =
        std::upper_bound(window_.frames.begin(), window_.frames.end(), ping.stamp,
                         [](Stamp stamp, const auto& frame) { return stamp < frame->stamp; });
    attach(**std::prev(after), ping);
  }
  if (config_.graph != GraphKind::tight || !config_.tight.use_depth) return;
  for (const auto& frame : window_.frames) attach_pressure_depth(*frame);
}

// Depth is measured relative to the start of the window, so tide, atmospheric pressure and sensor
// offset cancel.
void Estimator::attach_pressure_depth(Frame& frame) {
  const auto measured = pressure_depth_at(frame, depths_, rig_.down_sign());
  if (!measured || (frame.depth && frame.depth->stamp == measured->stamp)) return;
  if (!window_.depth_zero_m) {
    const SE3 pose = to_se3(frame.state.pose.data());
    window_.depth_zero_m =
        measured->depth_m - rig_.down_sign() * (pose * pressure_sensor_position(rig_)).z();
  }
  frame.depth = measured;
}

Eigen::Vector3d Estimator::predicted_ping(const Frame& frame, const imu::Preintegration& motion,
                                          const Eigen::Vector3d& gyro) const {
  const imu::NavState at =
      to_nav_state(predict(frame.state, motion, rig_.gravity(config_.gravity)));
  const SE3 dvl = to_se3(window_.calibration.T_body_dvl.data());
  return dvl.rotation.conjugate() * (at.v_body + (gyro - at.gyro_bias).cross(dvl.translation));
}

void Estimator::attach(Frame& frame, DvlMeasurement& measured) {
  if (!frame.uses_pings) return;
  const auto same = [&](const Frame::Ping& p) { return p.measured.stamp == measured.stamp; };
  if (std::any_of(frame.pings.begin(), frame.pings.end(), same)) return;
  const auto motion = preintegrate(frame.stamp, measured.stamp, frame.state);
  const auto sample = imu_.at(measured.stamp);
  if (!motion || !sample) return;
  if (!measured.predicted) measured.predicted = predicted_ping(frame, *motion, sample->gyro);
  frame.pings.push_back({measured, ping_factor(measured, motion, sample->gyro, rig_)});
  if (!first_ping_ && !frozen_) first_ping_ = measured.stamp;
}

}  // namespace apvi::vio
