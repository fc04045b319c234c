// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/config/fields.hpp"

namespace apvi::dipo {

/// A calibration state: estimated on line from an initial sigma, or held at what the rig says.
struct CalibrationState {
  bool estimate = false;
  double sigma = 0.0;
  double walk = 0.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("estimate", estimate, "estimate it on line, starting from the rig's value");
    v("sigma", sigma, Range{0.0, 100.0}, "how wrong the rig's value may be, one sigma");
    v("walk", walk, Range{0.0, 10.0}, "how fast it may wander, per square root of a second");
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
    v("window_s", window_s, Range{0.2, 60.0}, "span of pings that gives gravity and velocity [s]");
    v("heading_deg", heading_deg, Range{-360.0, 360.0},
      "heading of the body's x axis at the start, about world z [deg]");
    v("tilt_sigma_deg", tilt_sigma_deg, Range{0.01, 90.0}, "roll and pitch, one sigma [deg]");
    v("gyro_bias_sigma", gyro_bias_sigma, Range{0.0, 1.0},
      "turn-on bias, one sigma [rad/s]; null: as large as the noise over one "
      "second; MEMS gyros may need 0.1");
    v("accel_bias_sigma", accel_bias_sigma, Range{0.0, 10.0}, "turn-on bias, one sigma [m/s²]");
  }
};

struct EarthConfig {
  std::optional<double> latitude_deg;
  std::optional<double> heading_deg;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("latitude_deg", latitude_deg, Range{-90.0, 90.0},
      "turns Earth rotation on, for gyros good enough to feel it [deg]");
    v("heading_deg", heading_deg, Range{-360.0, 360.0},
      "true heading at the start; without it only the vertical part is used [deg]");
  }
};

struct InertialConfig {
  double gyro_noise_factor = 1.0;
  double accel_noise_factor = 1.0;
  double vibration_factor = 3.0;
  double max_gap_s = 0.5;
  double max_gyro = 8.7;
  double max_accel = 80.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("gyro_noise_factor", gyro_noise_factor, Range{0.1, 1000.0},
      "inflates the rig's gyro noise density");
    v("accel_noise_factor", accel_noise_factor, Range{0.1, 1000.0},
      "inflates the rig's accelerometer noise density");
    v("vibration_factor", vibration_factor, Range{0.0, 1000.0},
      "how much of the vibration seen between samples counts as noise; 0: trust the rig");
    v("max_gap_s", max_gap_s, Range{0.01, 60.0},
      "a longer pause between inertial samples is a gap: the filter goes on straight ahead [s]");
    v("max_gyro", max_gyro, Range{0.1, 100.0},
      "a sample that turns faster is a shock or a saturated sensor, and is left out [rad/s]");
    v("max_accel", max_accel, Range{10.0, 1000.0}, "the same for the specific force [m/s²]");
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
    v("enabled", enabled, "let noises follow the innovations of the DVL");
    v("rate", rate, Range{0.0, 1.0}, "how fast a noise grows, per ping");
    v("recovery_rate", recovery_rate, Range{0.0, 1.0}, "how fast it shrinks again, per ping");
    v("initial_accel_factor", initial_accel_factor, Range{1.0, 1e6},
      "what the accelerometer's noise density starts with");
    v("max_accel_factor", max_accel_factor, Range{1.0, 1e6},
      "the accelerometer's noise density grows up to this factor");
    v("max_dvl_variance_factor", max_dvl_variance_factor, Range{1.0, 1e6},
      "the DVL's variance grows up to this factor");
  }
};

struct DvlConfig {
  bool use_beams = true;
  double soft_gate = 11.3;
  double hard_gate_factor = 20.0;
  int max_rejected = 5;
  double parity_sigmas = 6.0;
  bool displacement = false;
  double displacement_inflation = 4.0;
  CalibrationState time_offset{.estimate = true, .sigma = 0.1, .walk = 1e-3};
  CalibrationState scale{.estimate = false, .sigma = 0.02, .walk = 1e-6};
  CalibrationState mounting{.estimate = false, .sigma = 0.09, .walk = 1e-6};
  CalibrationState lever_arm{.estimate = false, .sigma = 1.0, .walk = 1e-5};

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("use_beams", use_beams, "one update per beam in lock when beams are reported");
    v("soft_gate", soft_gate, Range{1.0, 1000.0},
      "NIS above which a ping counts less (chi square of three, 1 %)");
    v("hard_gate_factor", hard_gate_factor, Range{1.0, 1e6},
      "a ping whose NIS is this many times the soft gate is rejected");
    v("max_rejected", max_rejected, Range{1, 1000},
      "after so many rejections in a row the ping is believed instead of the state");
    v("parity_sigmas", parity_sigmas, Range{1.0, 1000.0},
      "four beams that disagree by more than this many sigma: the ping is not used");
    v("displacement", displacement, "use the second residual of the paper's Eq. 3 too");
    v("displacement_inflation", displacement_inflation, Range{1.0, 1000.0},
      "variance factor of that residual: it is made of velocities used already");
    v("time_offset", time_offset, "by how much stamps are late [s]");
    v("scale", scale, "relative scale error (sound speed)");
    v("mounting", mounting, "mounting rotation [rad]");
    v("lever_arm", lever_arm, "position in the body frame [m]");
  }
};

struct DepthConfig {
  double soft_gate = 9.0;
  double hard_gate_factor = 100.0;
  int max_rejected = 20;
  double swell_window_s = 10.0;
  CalibrationState bias{.estimate = true, .sigma = 0.05, .walk = 1e-4};

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("soft_gate", soft_gate, Range{1.0, 1000.0}, "NIS above which a sample counts less");
    v("hard_gate_factor", hard_gate_factor, Range{1.0, 1e6},
      "a sample whose NIS is this many times the soft gate is rejected");
    v("max_rejected", max_rejected, Range{1, 10000},
      "after so many rejections in a row the sample is believed instead of the state");
    v("swell_window_s", swell_window_s, Range{0.0, 120.0},
      "span over which waves are measured, whose pressure is no depth; 0: none are expected [s]");
    v("bias", bias, "atmosphere, tide, zero of the sensor [m]");
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
    v("enabled", enabled, "recognise standing still, when DVL and IMU agree");
    v("window_s", window_s, Range{0.1, 60.0}, "span that must be still [s]");
    v("max_speed", max_speed, Range{0.0, 1.0}, "largest DVL speed in it [m/s]");
    v("max_gyro_std", max_gyro_std, Range{0.0, 1.0}, "largest standard deviation [rad/s]");
    v("max_accel_std", max_accel_std, Range{0.0, 10.0}, "largest standard deviation [m/s²]");
    v("sigma", sigma, Range{1e-6, 1.0}, "of the zero-velocity measurement [m/s]");
  }
};

/// The `dipo` section: DVL, IMU and pressure odometry.
struct Config {
  InitializationConfig initialization;
  InertialConfig inertial;
  EarthConfig earth;
  AdaptationConfig adaptation;
  DvlConfig dvl;
  DepthConfig depth;
  ZeroVelocityConfig zero_velocity;
  double gravity = 9.80665;
  double history_s = 2.0;

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("initialization", initialization, "how the filter starts");
    v("inertial", inertial, "inertial sensor");
    v("earth", earth, "Earth rotation");
    v("adaptation", adaptation, "noise that follows the innovations");
    v("dvl", dvl, "Doppler velocity log");
    v("depth", depth, "pressure or depth sensor");
    v("zero_velocity", zero_velocity, "zero-velocity updates");
    v("gravity", gravity, Range{9.0, 10.5}, "local gravity [m/s²]");
    v("history_s", history_s, Range{0.1, 60.0}, "how far back a late measurement may reach [s]");
  }
};

}  // namespace apvi::dipo
