// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>

#include "apvi/dipo/config.hpp"
#include "apvi/imu/noise.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::dipo {

/// Measures how much inertial samples jump about from one to the next, which is what vibration of
/// the hull and thrusters does, and what no data sheet knows.
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
  std::deque<ImuSample> last_;   // three at most
  double accel_variance_ = 0.0;  // of one sample and axis [m²/s⁴]
  double gyro_variance_ = 0.0;   // [rad²/s²]
  double period_s_ = 0.01;
  int count_ = 0;
};

/// Decides whether the vehicle stands still: the IMU is quiet and the DVL, where it has lock, says
/// so.
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

/// Measures by how much depth as pressed differs from depth as swum. Waves press on the sensor too,
/// for seconds in one direction, so that what they add is neither white nor in any data sheet.
class SwellTracker {
 public:
  /// `window_s` of readings are looked at [s]; 0 turns it off.
  explicit SwellTracker(double window_s) : window_s_(window_s) {}

  /// `depth_m` as measured, `descent` the rate of depth as everybody else has it [m/s].
  void add(Stamp stamp, double depth_m, double descent);
  /// Standard deviation of the readings about the way swum, a straight line left free; outliers do
  /// not raise it [m]. 0 before three seconds of them.
  double sigma_m() const { return sigma_m_; }
  /// Readings that say the same thing again, because they lie within one stretch of a wave.
  double repeats() const { return repeats_; }

 private:
  struct Reading {
    Stamp stamp;
    double difference_m = 0.0;  // measured less swum
    double descent = 0.0;       // [m/s]
  };
  void measure();

  double window_s_;
  std::deque<Reading> readings_;
  std::optional<Stamp> last_;
  std::optional<Stamp> measured_;
  double swum_m_ = 0.0;
  double sigma_m_ = 0.0;
  double repeats_ = 1.0;
};

/// Gates innovations: a large one counts less, a huge one not at all, unless they keep coming.
class MeasurementGate {
 public:
  MeasurementGate(double soft_gate, double hard_gate_factor, int max_rejected)
      : soft_gate_(soft_gate),
        hard_gate_(soft_gate * hard_gate_factor),
        max_rejected_(max_rejected) {}

  /// Factor by which to multiply the innovation's covariance; nothing when the measurement is to be
  /// rejected.
  std::optional<double> judge(double nis);

 private:
  double soft_gate_;
  double hard_gate_;
  int max_rejected_;
  int rejected_ = 0;
};

/// Lets the noise follow the innovations of the DVL: a NIS that is too large on average means that
/// somebody is noisier than said. Who it is shows in how one innovation resembles the next (Mehra,
/// "On the identification of variances and adaptive Kalman filtering", 1970): when they keep their
/// sign, the motion model lags behind and the accelerometer is to blame (vibration, a lever arm
/// that nobody measured); when they alternate, the filter chases noise and the DVL is.
class NoiseAdapter {
 public:
  explicit NoiseAdapter(const AdaptationConfig& config)
      : config_(config), accel_factor_(config.enabled ? config.initial_accel_factor : 1.0) {}

  /// `innovation` in the DVL frame, `nis` its normalised square with `rows` degrees of freedom.
  void add(const Eigen::Vector3d& innovation, double nis, int rows);

  double accel_factor() const { return accel_factor_; }  ///< of the accelerometer's noise density
  double dvl_variance_factor() const { return dvl_variance_factor_; }

 private:
  AdaptationConfig config_;
  Eigen::Vector3d last_ = Eigen::Vector3d::Zero();
  double product_ = 0.0;  // running mean of innovation . last innovation
  double power_ = 0.0;    // and of its square
  double accel_factor_ = 1.0;
  double dvl_variance_factor_ = 1.0;
};

}  // namespace apvi::dipo
