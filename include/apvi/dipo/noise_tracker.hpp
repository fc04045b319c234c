// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>

#include "apvi/dipo/config.hpp"
#include "apvi/imu/noise.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::dipo {

/// Measures how much inertial samples jump about from one to the next, which is what vibration of the
/// hull and thrusters does, and what no data sheet knows.
class VibrationTracker {
 public:
  VibrationTracker(const InertialConfig& config, const imu::Noise& sheet)
      : config_(config), sheet_(sheet) {}

  void add(const ImuSample& sample);
  /// The data sheet's noise, inflated by what was measured up to now.
  imu::Noise noise() const;

 private:
  InertialConfig config_;
  imu::Noise sheet_;
  std::deque<ImuSample> last_;     // three at most
  double accel_variance_ = 0.0;    // of one sample and axis [m²/s⁴]
  double gyro_variance_ = 0.0;     // [rad²/s²]
  double period_s_ = 0.01;
  int count_ = 0;
};

/// Decides whether the vehicle stands still: the IMU is quiet and the DVL, where it has lock, says so.
class StillnessDetector {
 public:
  explicit StillnessDetector(const ZeroVelocityConfig& config) : config_(config) {}

  void add(const ImuSample& sample);
  void add(const DvlSample& sample);
  /// True at most once per window.
  bool is_still();

 private:
  ZeroVelocityConfig config_;
  std::deque<ImuSample> imu_;
  std::deque<DvlSample> pings_;
};

/// Gates innovations and lets a sensor's noise follow them: a NIS that is too large on average means
/// that the noise is larger than the rig says.
class MeasurementGate {
 public:
  MeasurementGate(double soft_gate, double hard_gate_factor, int max_rejected, double adapt_rate,
                  double max_scale)
      : soft_gate_(soft_gate),
        hard_gate_(soft_gate * hard_gate_factor),
        max_rejected_(max_rejected),
        adapt_rate_(adapt_rate),
        max_scale_(max_scale) {}

  /// Factor by which to multiply the innovation's covariance; nothing when the measurement is to be
  /// rejected.
  std::optional<double> judge(double nis, int rows);
  /// Variance factor that the noise has reached by following the NIS.
  double scale() const { return scale_; }

 private:
  double soft_gate_;
  double hard_gate_;
  int max_rejected_;
  double adapt_rate_;
  double max_scale_;
  double scale_ = 1.0;
  int rejected_ = 0;
};

}  // namespace apvi::dipo
