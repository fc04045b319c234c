// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/config/fields.hpp"
#include "apvi/core/constants.hpp"

namespace apvi::dipo {

/// A calibration parameter, either estimated online or fixed at the value of the rig.
struct CalibrationState {
  bool estimate = false;
  double sigma = 0.0;
  double walk = 0.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("estimate", estimate, "estimate online, starting from the rig's value");
    v("sigma", sigma, Range{0.0, 100.0}, "initial uncertainty of the rig's value, one sigma");
    v("walk", walk, Range{0.0, 10.0}, "random walk, per square root of a second");
  }
};

struct InitializationConfig {
  double window_s = 0.6;
  double heading_deg = 0.0;
  double tilt_sigma_deg = 3.0;
  std::optional<double> gyro_bias_sigma;
  double accel_bias_sigma = 0.05;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("window_s", window_s, Range{0.2, 60.0},
      "span of DVL pings from which gravity and velocity are initialized [s]");
    v("heading_deg", heading_deg, Range{-360.0, 360.0},
      "initial heading of the body's x axis about world z [deg]");
    v("tilt_sigma_deg", tilt_sigma_deg, Range{0.01, 90.0},
      "initial roll and pitch uncertainty, one sigma [deg]");
    v("gyro_bias_sigma", gyro_bias_sigma, Range{0.0, 1.0},
      "initial gyro bias uncertainty of the filter, one sigma [rad/s]; null: the gyro noise over "
      "one second; MEMS gyros may need 0.1");
    v("accel_bias_sigma", accel_bias_sigma, Range{0.0, 10.0},
      "initial accelerometer bias uncertainty of the filter, one sigma [m/s²]");
  }
};

struct EarthConfig {
  std::optional<double> latitude_deg;
  std::optional<double> heading_deg;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("latitude_deg", latitude_deg, Range{-90.0, 90.0},
      "latitude; null: Earth rotation is not modeled, as most gyros cannot measure it [deg]");
    v("heading_deg", heading_deg, Range{-360.0, 360.0},
      "initial true heading; null: only the vertical component of the Earth rotation is modeled "
      "[deg]");
  }
};

struct InertialConfig {
  double gyro_noise_factor = 1.0;
  double accel_noise_factor = 1.0;
  double vibration_factor = 3.0;
  double max_gap_s = 0.5;
  double segment_gap_s = 3.0;
  double max_gyro = 8.7;
  double max_accel = 80.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("gyro_noise_factor", gyro_noise_factor, Range{0.1, 1000.0},
      "multiplies the rig's gyro noise density");
    v("accel_noise_factor", accel_noise_factor, Range{0.1, 1000.0},
      "multiplies the rig's accelerometer noise density");
    v("vibration_factor", vibration_factor, Range{0.0, 1000.0},
      "fraction of the vibration measured between samples that is added to the noise; 0: only the "
      "rig's noise");
    v("max_gap_s", max_gap_s, Range{0.01, 60.0},
      "a longer gap between IMU samples is bridged at constant velocity [s]");
    v("segment_gap_s", segment_gap_s, Range{0.01, 1e9},
      "a longer gap between IMU samples begins a new segment, as nothing can be said about the "
      "motion: at 0.2 rad/s and 0.3 m/s² heading and velocity change by 0.6 rad and 0.9 m/s in 3 s "
      "[s]");
    v("max_gyro", max_gyro, Range{0.1, 100.0},
      "samples with a larger angular rate are rejected as shock or saturation [rad/s]");
    v("max_accel", max_accel, Range{10.0, 1000.0},
      "samples with a larger specific force are rejected as shock or saturation [m/s²]");
  }
};

struct AdaptationConfig {
  bool enabled = true;
  double rate = 0.3;
  double recovery_rate = 0.003;
  double initial_accel_factor = 1.0;
  double max_accel_factor = 300.0;
  double max_dvl_variance_factor = 100.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "adapt the accelerometer and DVL noise to the DVL innovations");
    v("rate", rate, Range{0.0, 1.0}, "gain of a noise increase, per ping");
    v("recovery_rate", recovery_rate, Range{0.0, 1.0}, "gain of a noise decrease, per ping");
    v("initial_accel_factor", initial_accel_factor, Range{1.0, 1e6},
      "initial factor on the accelerometer noise density");
    v("max_accel_factor", max_accel_factor, Range{1.0, 1e6},
      "maximum factor on the accelerometer noise density");
    v("max_dvl_variance_factor", max_dvl_variance_factor, Range{1.0, 1e6},
      "maximum factor on the DVL variance");
  }
};

struct DvlConfig {
  bool use_beams = true;
  double soft_gate = 11.3;
  double hard_gate_factor = 20.0;
  int max_consecutive_rejections = 5;
  double parity_sigmas = 6.0;
  bool use_displacement = false;
  double displacement_variance_factor = 4.0;
  CalibrationState time_offset{.estimate = true, .sigma = 0.1, .walk = 1e-3};
  CalibrationState scale{.estimate = false, .sigma = 0.02, .walk = 1e-6};
  CalibrationState mounting{.estimate = false, .sigma = 0.09, .walk = 1e-6};
  CalibrationState lever_arm{.estimate = false, .sigma = 1.0, .walk = 1e-5};

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("use_beams", use_beams,
      "one update per beam with bottom lock if beams are reported; false: one per velocity vector");
    v("soft_gate", soft_gate, Range{1.0, 1000.0},
      "NIS above which a ping is downweighted (chi-square, 3 degrees of freedom, 1 %)");
    v("hard_gate_factor", hard_gate_factor, Range{1.0, 1e6},
      "a ping whose NIS exceeds soft_gate by this factor is rejected");
    v("max_consecutive_rejections", max_consecutive_rejections, Range{1, 1000},
      "after this many consecutive rejections the next ping is accepted");
    v("parity_sigmas", parity_sigmas, Range{1.0, 1000.0},
      "a ping whose four beams are inconsistent by more than this is not used [sigma]");
    v("use_displacement", use_displacement,
      "also use the second residual of the paper's Eq. 3 (displacement between pings)");
    v("displacement_variance_factor", displacement_variance_factor, Range{1.0, 1000.0},
      "variance factor of that residual, which reuses the velocities of the first");
    v("time_offset", time_offset, "how late the DVL's stamps are [s]");
    v("scale", scale, "relative scale error (speed of sound)");
    v("mounting", mounting, "mounting rotation [rad]");
    v("lever_arm", lever_arm, "position in the body frame [m]");
  }
};

struct PressureDepthConfig {
  double soft_gate = 9.0;
  double hard_gate_factor = 100.0;
  int max_consecutive_rejections = 20;
  double swell_window_s = 10.0;
  CalibrationState bias{.estimate = true, .sigma = 0.05, .walk = 1e-4};

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("soft_gate", soft_gate, Range{1.0, 1000.0}, "NIS above which a sample is downweighted");
    v("hard_gate_factor", hard_gate_factor, Range{1.0, 1e6},
      "a sample whose NIS exceeds soft_gate by this factor is rejected");
    v("max_consecutive_rejections", max_consecutive_rejections, Range{1, 10000},
      "after this many consecutive rejections the next sample is accepted");
    v("swell_window_s", swell_window_s, Range{0.0, 120.0},
      "window over which pressure noise from surface waves is measured; 0: no waves [s]");
    v("bias", bias, "bias: atmospheric pressure, tide, zero offset [m]");
  }
};

struct ZeroVelocityConfig {
  bool enabled = true;
  double window_s = 1.0;
  double max_speed = 0.02;
  double max_gyro_std = 0.003;
  double max_accel_std = 0.05;
  double sigma = 0.01;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "detect standstill when DVL and IMU agree");
    v("window_s", window_s, Range{0.1, 60.0}, "minimum duration of a standstill [s]");
    v("max_speed", max_speed, Range{0.0, 1.0}, "maximum DVL speed in the window [m/s]");
    v("max_gyro_std", max_gyro_std, Range{0.0, 1.0},
      "maximum standard deviation of the gyro in the window [rad/s]");
    v("max_accel_std", max_accel_std, Range{0.0, 10.0},
      "maximum standard deviation of the accelerometer in the window [m/s²]");
    v("sigma", sigma, Range{1e-6, 1.0},
      "standard deviation of the zero-velocity measurement [m/s]");
  }
};

/// The `dipo` section: DVL, IMU and pressure odometry.
struct Config {
  InitializationConfig initialization;
  InertialConfig inertial;
  EarthConfig earth;
  AdaptationConfig adaptation;
  DvlConfig dvl;
  PressureDepthConfig depth;
  ZeroVelocityConfig zero_velocity;
  double gravity = kStandardGravity;  ///< [m/s²]; the key is `localization.gravity`
  double history_s = 2.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("initialization", initialization, "filter initialization");
    v("inertial", inertial, "IMU");
    v("earth", earth, "Earth rotation");
    v("adaptation", adaptation, "adaptive measurement and process noise");
    v("dvl", dvl, "Doppler velocity log");
    v("depth", depth, "pressure or depth sensor");
    v("zero_velocity", zero_velocity, "zero-velocity updates");
    v("history_s", history_s, Range{0.1, 60.0},
      "length of the state history kept for delayed measurements [s]");
  }
};

}  // namespace apvi::dipo
