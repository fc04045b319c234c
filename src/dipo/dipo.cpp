// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/dipo.hpp"

#include <algorithm>
#include <cmath>

#include "apvi/core/constants.hpp"
#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"
#include "dipo/dvl_ping.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kEarthRate = 7.292115e-5;  // [rad/s]

imu::EarthModel make_world(const Config& config, const Rig& rig) {
  imu::EarthModel world;
  world.gravity = rig.gravity(config.gravity);
  if (!config.earth.latitude_deg) return world;
  const double latitude = *config.earth.latitude_deg * kRadiansPerDegree;
  const double up = kEarthRate * std::sin(latitude);
  const double north = config.earth.heading_deg ? kEarthRate * std::cos(latitude) : 0.0;
  world.earth_rate =
      rig.world == WorldFrame::ned ? Vector3d(north, 0.0, -up) : Vector3d(0.0, north, up);
  return world;
}

CalibrationRandomWalk make_walk(const Config& config) {
  const auto walk = [](const CalibrationState& c) { return c.estimate ? c.walk : 0.0; };
  return {.time_offset = walk(config.dvl.time_offset),
          .scale = walk(config.dvl.scale),
          .mounting = walk(config.dvl.mounting),
          .lever_arm = walk(config.dvl.lever_arm),
          .depth_bias = walk(config.depth.bias)};
}

imu::Noise datasheet_noise(const Rig& rig) {
  return {.gyro = rig.imu->gyro_noise_density,
          .accel = rig.imu->accel_noise_density,
          .gyro_walk = rig.imu->gyro_random_walk,
          .accel_walk = rig.imu->accel_random_walk};
}

const Rig& checked(const Rig& rig) {
  if (!rig.imu) fail_input("rig: imu0: missing; odometry needs an IMU");
  if (!rig.dvl) fail_input("rig: dvl0: missing; DVL-inertial odometry needs a DVL");
  return rig;
}

FilterHistory::Model with_noise_added(FilterHistory::Model model,
                                      const Measurement::Covariance& more) {
  return [model = std::move(model), more](const Eskf& at, const Kinematics& kinematics) {
    Measurement m = model(at, kinematics);
    m.R += more;
    return m;
  };
}

// Inflates R so that the covariance of the innovation grows by `factor`.
FilterHistory::Model downweighted(FilterHistory::Model model, const Measurement& at_gate,
                                  const Eskf& filter, double factor) {
  const Measurement::Covariance innovation =
      at_gate.H * filter.covariance() * at_gate.H.transpose() + at_gate.R;
  return with_noise_added(std::move(model), (factor - 1.0) * innovation);
}

}  // namespace

std::string_view to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::accepted:
      return "accepted";
    case Verdict::downweighted:
      return "downweighted";
    case Verdict::rejected:
      return "rejected";
    case Verdict::no_lock:
      return "no_lock";
    case Verdict::beams_disagree:
      return "beams_disagree";
    case Verdict::repeated:
      return "repeated";
    case Verdict::too_old:
      return "too_old";
  }
  return "";
}

Dipo::Dipo(const Config& config, const Rig& rig)
    : config_(config),
      rig_(checked(rig)),
      world_(make_world(config, rig)),
      history_(world_, make_walk(config), Duration::from_seconds(config.history_s),
               Duration::from_seconds(config.inertial.max_gap_s)),
      initializer_(config, rig),
      vibration_(config.inertial, datasheet_noise(rig)),
      stationary_(config.zero_velocity),
      adapter_(config.adaptation),
      swell_(config.depth.swell_window_s),
      dvl_gate_(config.dvl.soft_gate, config.dvl.hard_gate_factor,
                config.dvl.max_consecutive_rejections),
      pressure_depth_gate_(config.depth.soft_gate, config.depth.hard_gate_factor,
                           config.depth.max_consecutive_rejections) {}

imu::Noise Dipo::noise_now() const {
  imu::Noise noise = vibration_.noise();
  noise.accel *= adapter_.accel_factor();
  return noise;
}

void Dipo::add(const ImuSample& sample) {
  if (last_imu_ && sample.stamp <= last_imu_->stamp) return;  // counted by the reader
  if (sample.gyro.cwiseAbs().maxCoeff() > config_.inertial.max_gyro ||
      sample.accel.cwiseAbs().maxCoeff() > config_.inertial.max_accel) {
    ++saturated_samples_;
    return;
  }
  if (last_imu_ && seconds_between(last_imu_->stamp, sample.stamp) > config_.inertial.max_gap_s) {
    ++gaps_;
  }
  if (last_imu_ &&
      seconds_between(last_imu_->stamp, sample.stamp) > config_.inertial.segment_gap_s) {
    begin_segment();
  }
  last_imu_ = sample;
  vibration_.add(sample);
  stationary_.add(sample);
  if (!initialized()) {
    initializer_.add(sample);
    early_imu_.push_back(sample);
    if (const auto found = initializer_.try_start()) start(*found);
    const Stamp keep = sample.stamp - Duration::from_seconds(3.0 * config_.initialization.window_s);
    while (!early_imu_.empty() && early_imu_.front().stamp < keep) early_imu_.pop_front();
    return;
  }
  history_.push(sample, noise_now());
  apply_pending();
  update_if_stationary(sample);
}

void Dipo::add(const DvlSample& sample) {
  // Some telemetry links send each ping several times.
  if (last_ping_ && same_ping(*last_ping_, sample)) {
    report_dvl({.stamp = sample.stamp, .verdict = Verdict::repeated});
    return;
  }
  last_ping_ = sample;
  stationary_.add(sample);
  if (!initialized()) initializer_.add(sample);
  pending_.emplace_back(sample);
  apply_pending();
}

void Dipo::report_dvl(Report report) {
  report.accel_factor = adapter_.accel_factor();
  report.dvl_variance_factor = adapter_.dvl_variance_factor();
  dvl_reports_.push_back(report);
}

void Dipo::add(const PressureSample& sample) {
  if (!rig_.pressure) return;
  add_pressure_depth({sample.stamp, rig_.pressure->depth(sample.pressure_pa),
                      rig_.pressure->p_body_sensor, rig_.pressure->noise_m});
}

void Dipo::add(const PressureDepthSample& sample) {
  if (!rig_.depth) return;
  add_pressure_depth(
      {sample.stamp, sample.depth_m, rig_.depth->p_body_sensor, rig_.depth->noise_m});
}

void Dipo::add_pressure_depth(const PressureDepthReading& reading) {
  if (!initialized()) initializer_.add_pressure_depth(reading.depth_m, reading.p_body_sensor);
  pending_.emplace_back(reading);
  apply_pending();
}

// What was measured before the gap says nothing about the motion after it.
void Dipo::begin_segment() {
  if (initialized()) {
    last_segment_ = Segment{history_.newest(), history_.newest_filter(), segment_error_};
  }
  history_.clear();
  early_imu_.clear();
  last_used_ping_.reset();
  vibration_ = VibrationTracker(config_.inertial, datasheet_noise(rig_));
  stationary_ = StationaryDetector(config_.zero_velocity);
  swell_ = SwellTracker(config_.depth.swell_window_s);
  const imu::NavState nav = last_segment_ ? last_segment_->filter.state().nav : imu::NavState{};
  initializer_ = Initializer(config_, rig_, nav.gyro_bias, nav.accel_bias);
}

void Dipo::start(const Initializer::Start& fresh) {
  Initializer::Start start = fresh;
  if (last_segment_) {
    start = continue_segment(*last_segment_, fresh, make_walk(config_), rig_);
    segment_error_ = error_after(*last_segment_, fresh);
  }
  history_.start(start.sample, Eskf(start.state, start.covariance));
  for (const ImuSample& sample : early_imu_) {
    if (sample.stamp > start.sample.stamp) history_.push(sample, noise_now());
  }
  early_imu_.clear();
  apply_pending();
}

void Dipo::apply_pending() {
  if (initialized()) {
    std::erase_if(pending_, [this](const Sample& sample) {
      return std::visit([this](const auto& s) { return apply(s); }, sample);
    });
  }
  // Limits the memory if the DVL never locks or the IMU stops.
  constexpr std::size_t kMaxPending = 4096;
  while (pending_.size() > kMaxPending) pending_.pop_front();
}

Verdict Dipo::check_ping(const DvlSample& ping) const {
  if (!is_usable(ping, config_.dvl.use_beams)) return Verdict::no_lock;
  const double sigma = rig_.dvl->velocity_noise * std::sqrt(adapter_.dvl_variance_factor());
  return beam_disagreement(ping, *rig_.dvl) > config_.dvl.parity_sigmas * sigma
             ? Verdict::beams_disagree
             : Verdict::accepted;
}

FilterHistory::Model Dipo::dvl_model(const DvlSample& ping, double offset_s) const {
  const double noise = rig_.dvl->velocity_noise;
  const double variance = noise * noise * adapter_.dvl_variance_factor();
  const bool by_beam = config_.dvl.use_beams && valid_beams(ping) > 0;
  return [=, world = world_, dvl = *rig_.dvl](const Eskf& filter, const Kinematics& k) {
    return ping_measurement(filter, k, world, dvl, ping, by_beam, variance, offset_s);
  };
}

void Dipo::insert_displacement(const DvlSample& ping, Stamp stamp) {
  const Eskf filter = history_.filter_at(stamp);
  const State& x = filter.state();
  const Vector3d gyro = history_.kinematics_at(stamp).gyro - x.nav.gyro_bias;
  const Vector3d v_body =
      x.R_body_dvl * rig_.dvl->true_velocity(ping.velocity) / (1.0 + x.dvl_scale_error) -
      gyro.cross(x.p_body_dvl);
  const auto last = std::exchange(last_used_ping_, UsedPing{stamp, x.nav.R_world_body, v_body});
  if (!last || stamp <= last->stamp) return;
  const double dt = seconds_between(last->stamp, stamp);
  constexpr double kMaxInterval_s =
      2.0;  // over longer intervals the trapezoidal rule is too inaccurate
  if (dt > kMaxInterval_s) return;
  const Vector3d v_last = x.nav.R_world_body.conjugate() * (last->R_world_body * last->v_body);
  const Vector3d displacement = 0.5 * dt * (v_last + v_body);
  // Noise of two independent velocities, used a second time, and the curvature of the path.
  constexpr double kCurvature = 0.1;
  const double noise = rig_.dvl->velocity_noise;
  const double variance = config_.dvl.displacement_variance_factor * 0.5 * noise * noise * dt * dt +
                          std::pow(kCurvature * dt * (v_body - v_last).norm(), 2);
  history_.insert(stamp, [=](const Eskf& at, const Kinematics&) {
    return dvl_displacement(at.state(), displacement, variance * Matrix3d::Identity());
  });
}

std::optional<FilterHistory::Model> Dipo::validate(Stamp stamp, FilterHistory::Model model,
                                                   MeasurementGate& gate, Report& report) const {
  if (!history_.covers(stamp)) {
    report.verdict = Verdict::too_old;
    return std::nullopt;
  }
  const Eskf filter = history_.filter_at(stamp);
  const Measurement m = model(filter, history_.kinematics_at(stamp));
  report.nis = filter.nis(m);
  report.rows = m.rows();
  const auto factor = gate.validate(report.nis);
  if (!factor) {
    report.verdict = Verdict::rejected;
    return std::nullopt;
  }
  if (*factor <= 1.0) return model;
  report.verdict = Verdict::downweighted;
  return downweighted(std::move(model), m, filter, *factor);
}

bool Dipo::apply(const DvlSample& ping) {
  const double offset_s = history_.newest_filter().state().dvl_time_offset_s;
  const Stamp stamp = ping.stamp - Duration::from_seconds(offset_s);
  if (stamp > history_.newest()) return false;
  Report report{.stamp = ping.stamp, .verdict = check_ping(ping)};
  if (report.verdict == Verdict::accepted) {
    if (auto model = validate(stamp, dvl_model(ping, offset_s), dvl_gate_, report)) {
      if (ping.valid) {
        const Vector3d expected =
            predict_dvl(history_.filter_at(stamp).state(), history_.kinematics_at(stamp).gyro);
        adapter_.add(rig_.dvl->true_velocity(ping.velocity) - expected, report.nis, report.rows);
        if (config_.dvl.use_displacement) insert_displacement(ping, stamp);
      }
      history_.insert(stamp, std::move(*model), config_.dvl.use_displacement);
    }
  }
  report_dvl(report);
  return true;
}

double Dipo::swell_m() const {
  const double noise = rig_.pressure ? rig_.pressure->noise_m
                       : rig_.depth  ? rig_.depth->noise_m
                                     : 0.0;
  return std::sqrt(std::max(0.0, std::pow(swell_.sigma_m(), 2) - noise * noise));
}

bool Dipo::apply(const PressureDepthReading& reading) {
  if (reading.stamp > history_.newest()) return false;
  const double sign = rig_.down_sign();
  const double swell = std::pow(swell_m(), 2);
  const double variance = reading.noise_m * reading.noise_m + swell;
  FilterHistory::Model depth_model = [=](const Eskf& at, const Kinematics&) {
    return pressure_depth(at.state(), reading.p_body_sensor, sign, reading.depth_m, variance);
  };
  Report report{.stamp = reading.stamp};
  if (auto model = validate(reading.stamp, std::move(depth_model), pressure_depth_gate_, report)) {
    // The gate uses the variance of a single reading; the filter accounts for the correlation of
    // consecutive readings.
    const Measurement::Covariance correlated =
        Measurement::Covariance::Constant(1, 1, (swell_.correlated_samples() - 1.0) * swell);
    history_.insert(reading.stamp, with_noise_added(std::move(*model), correlated));
  }
  if (history_.covers(reading.stamp)) {
    const imu::NavState nav = history_.filter_at(reading.stamp).state().nav;
    const double lever = (nav.R_world_body * reading.p_body_sensor).z();
    swell_.add(reading.stamp, reading.depth_m - sign * lever,
               sign * (nav.R_world_body * nav.v_body).z());
  }
  pressure_depth_reports_.push_back(report);
  return true;
}

void Dipo::update_if_stationary(const ImuSample& sample) {
  if (!stationary_.is_stationary()) return;
  const double variance = config_.zero_velocity.sigma * config_.zero_velocity.sigma;
  history_.insert(sample.stamp, [variance](const Eskf& at, const Kinematics&) {
    return zero_velocity(at.state(), variance);
  });
  ++zero_velocity_updates_;
}

std::string Dipo::waiting_for() const {
  if (initialized()) return "";
  switch (initializer_.waiting()) {
    case Initializer::Waiting::imu:
      return "inertial samples";
    case Initializer::Waiting::dvl_lock:
      return "a DVL ping with bottom lock";
    case Initializer::Waiting::window:
      return "a span of DVL pings";
  }
  return "";
}

std::optional<Estimate> Dipo::latest() const {
  if (!initialized()) return std::nullopt;
  return estimate(history_.newest(), history_.newest_filter());
}

std::optional<Estimate> Dipo::at(Stamp stamp) const {
  if (!initialized() || stamp < history_.oldest() || stamp > history_.newest()) {
    return std::nullopt;
  }
  return estimate(stamp, history_.filter_at(stamp));
}

Estimate Dipo::estimate(Stamp stamp, const Eskf& filter) const {
  return {stamp, filter.state(), filter.covariance(),
          segment_error_.covariance(filter.state().nav.pose())};
}

}  // namespace apvi::dipo
