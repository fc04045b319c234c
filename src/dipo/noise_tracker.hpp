// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>

#include "apvi/dipo/config.hpp"
#include "apvi/sensors/samples.hpp"
#include "imu/noise.hpp"

namespace apvi::dipo {

/// Estimates the vibration noise of the IMU (hull, thrusters) from differences of consecutive
/// samples; data sheets do not include it.
class VibrationTracker {
 public:
  VibrationTracker(const InertialConfig& config, const imu::Noise& datasheet)
      : config_(config), datasheet_(datasheet) {}

  void add(const ImuSample& sample);
  /// Noise of the data sheet, inflated by the vibration estimated so far.
  imu::Noise noise() const;

 private:
  InertialConfig config_;
  imu::Noise datasheet_;
  std::deque<ImuSample> last_;   // at most three
  double accel_variance_ = 0.0;  // per sample and axis [m²/s⁴]
  double gyro_variance_ = 0.0;   // [rad²/s²]
  double period_s_ = 0.01;
  int count_ = 0;
};

/// Detects that the vehicle is stationary: low IMU variance and low DVL speed.
class StationaryDetector {
 public:
  explicit StationaryDetector(const ZeroVelocityConfig& config) : config_(config) {}

  void add(const ImuSample& sample);
  void add(const DvlSample& sample);
  /// Returns true at most once per window.
  bool is_stationary();

 private:
  ZeroVelocityConfig config_;
  std::deque<ImuSample> imu_;
  std::deque<DvlSample> pings_;
};

/// Estimates the error that surface waves cause in the measured pressure depth. It has one sign for
/// seconds, so it is not white noise, and data sheets do not include it.
class SwellTracker {
 public:
  /// `window_s`: length of the evaluation window [s]; 0 disables the tracker.
  explicit SwellTracker(double window_s) : window_s_(window_s) {}

  /// `depth_m` is the measured pressure depth, `descent_rate` the rate of change of depth according
  /// to the filter [m/s].
  void add(Stamp stamp, double depth_m, double descent_rate);
  /// Robust standard deviation of measured minus integrated depth, after removing a linear trend
  /// [m]. A small default during the first three seconds.
  double sigma_m() const { return sigma_m_; }
  /// Number of readings within one correlation time of the waves.
  double correlated_samples() const { return correlated_samples_; }

 private:
  struct Reading {
    Stamp stamp;
    double difference_m = 0.0;  // measured - integrated depth
    double descent_rate = 0.0;  // [m/s]
  };
  void measure();

  double window_s_;
  std::deque<Reading> readings_;
  std::optional<Stamp> last_;
  std::optional<Stamp> last_measured_;
  double integrated_depth_m_ = 0.0;
  double sigma_m_ = 0.0;
  double correlated_samples_ = 1.0;
};

/// Gates innovations: large ones are downweighted, very large ones rejected, unless rejections
/// persist.
class MeasurementGate {
 public:
  MeasurementGate(double soft_gate, double hard_gate_factor, int max_rejected)
      : soft_gate_(soft_gate),
        hard_gate_(soft_gate * hard_gate_factor),
        max_rejected_(max_rejected) {}

  /// Factor for the innovation's covariance; nullopt if the measurement is rejected.
  std::optional<double> validate(double nis);

 private:
  double soft_gate_;
  double hard_gate_;
  int max_rejected_;
  int rejected_ = 0;
};

/// Adapts the noise model to the innovations of the DVL: a mean NIS above one means that a noise is
/// set too low. The correlation of successive innovations tells which one (Mehra, "On the
/// identification of variances and adaptive Kalman filtering", 1970): innovations of constant sign
/// mean that the motion model lags, so the accelerometer noise is raised (vibration, unmodeled
/// lever arm); alternating innovations mean that the DVL noise is set too low.
class NoiseAdapter {
 public:
  explicit NoiseAdapter(const AdaptationConfig& config)
      : config_(config), accel_factor_(config.enabled ? config.initial_accel_factor : 1.0) {}

  /// `innovation` is in the DVL frame; `nis` is its normalized square with `rows` degrees of
  /// freedom.
  void add(const Eigen::Vector3d& innovation, double nis, int rows);

  double accel_factor() const { return accel_factor_; }  ///< for the accelerometer's noise density
  double dvl_variance_factor() const { return dvl_variance_factor_; }

 private:
  AdaptationConfig config_;
  Eigen::Vector3d last_ = Eigen::Vector3d::Zero();
  double product_ = 0.0;  // running mean of innovation . previous innovation
  double power_ = 0.0;    // running mean of the squared innovation
  double accel_factor_ = 1.0;
  double dvl_variance_factor_ = 1.0;
};

}  // namespace apvi::dipo
