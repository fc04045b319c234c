// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/sensors/samples.hpp"
#include "geometry/spline.hpp"
#include "sim/motion/events.hpp"

namespace apvi::sim {

/// ideal: no errors; tactical: a fiber-optic or high-end MEMS unit (about 0.04 deg/sqrt(h), 1
/// deg/h); mems: an industrial unit (ADIS16448, GX5 class); consumer: a low-cost chip.
enum class ImuPreset { ideal, tactical, mems, consumer };

/// The `imu` section of a scene. Defaults are those of the preset `mems`; another preset replaces
/// all of them, and keys given in addition override single values.
struct ImuSimConfig {
  bool enabled = true;
  ImuPreset preset = ImuPreset::mems;
  double rate_hz = 200.0;
  double gyro_noise_density = 1.6968e-4;
  double gyro_random_walk = 1.9393e-5;
  double accel_noise_density = 2.0e-3;
  double accel_random_walk = 3.0e-4;
  double gyro_bias_sigma = 7e-4;
  double accel_bias_sigma = 4e-2;
  double scale_error = 1e-3;
  double misalignment_deg = 0.05;
  double gyro_range = 17.45;
  double accel_range = 176.0;
  bool earth_rotation = false;
  double latitude_deg = 59.0;

  /// Sets all values to those of a preset.
  void use(ImuPreset other);

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "simulate this sensor");
    const ImuPreset before = preset;
    v("preset", preset,
      config::Choices<ImuPreset>{{"ideal", ImuPreset::ideal},
                                 {"tactical", ImuPreset::tactical},
                                 {"mems", ImuPreset::mems},
                                 {"consumer", ImuPreset::consumer}},
      "device class; the keys below override its values");
    if (preset != before) use(preset);
    v("rate_hz", rate_hz, Range{10.0, 2000.0}, "sample rate [Hz]");
    v("gyro_noise_density", gyro_noise_density, Range{0.0, 1.0}, "white noise [rad/s/sqrt(Hz)]");
    v("gyro_random_walk", gyro_random_walk, Range{0.0, 1.0}, "bias random walk [rad/s²/sqrt(Hz)]");
    v("accel_noise_density", accel_noise_density, Range{0.0, 10.0}, "white noise [m/s²/sqrt(Hz)]");
    v("accel_random_walk", accel_random_walk, Range{0.0, 10.0}, "bias random walk [m/s³/sqrt(Hz)]");
    v("gyro_bias_sigma", gyro_bias_sigma, Range{0.0, 1.0},
      "turn-on bias per axis, one sigma [rad/s]");
    v("accel_bias_sigma", accel_bias_sigma, Range{0.0, 10.0},
      "turn-on bias per axis, one sigma [m/s²]");
    v("scale_error", scale_error, Range{0.0, 0.2}, "scale error per axis, one sigma");
    v("misalignment_deg", misalignment_deg, Range{0.0, 10.0},
      "misalignment between axes, one sigma [deg]");
    v("gyro_range", gyro_range, Range{0.1, 1e6}, "measurement range; readings saturate [rad/s]");
    v("accel_range", accel_range, Range{11.0, 1e6}, "measurement range; readings saturate [m/s²]");
    v("earth_rotation", earth_rotation, "simulate Earth rotation (x east, y north)");
    v("latitude_deg", latitude_deg, Range{-90.0, 90.0}, "latitude for earth_rotation [deg]");
  }
};

/// Readings and, at the same index, the ground truth: stamp, motion, and the biases added to the
/// reading (scale errors and misalignment are not included in the biases).
struct ImuRecord {
  std::vector<ImuSample> samples;
  std::vector<Motion> truth;
  std::vector<Eigen::Vector3d> gyro_bias;   ///< [rad/s]
  std::vector<Eigen::Vector3d> accel_bias;  ///< [m/s²]
};

/// Simulates an IMU at the body origin from `start` for `duration_s`. Specific force is R^T (a -
/// g), from the analytic derivatives of the spline.
ImuRecord simulate_imu(const Se3Spline& spline, const ImuSimConfig& config,
                       const EventSchedule& events, Stamp start, double duration_s, double gravity,
                       std::uint64_t seed);

}  // namespace apvi::sim
