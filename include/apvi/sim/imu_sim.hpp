// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/geometry/spline.hpp"
#include "apvi/sensors/samples.hpp"
#include "apvi/sim/events.hpp"

namespace apvi::sim {

/// ideal: no error at all; tactical: a fibre-optic or large MEMS unit (some 0.04 deg/sqrt(h), 1
/// deg/h); mems: an industrial unit (ADIS16448, GX5 class); consumer: a part of a few euros.
enum class ImuPreset { ideal, tactical, mems, consumer };

/// The `imu` section of a scene. The numbers are those of the preset `mems`; another preset
/// replaces them all, and keys given beside it replace single ones.
struct ImuSimConfig {
  bool enabled = true;
  ImuPreset preset = ImuPreset::mems;
  double rate_hz = 200.0;
  double gyro_noise_density = 1.6968e-4;
  double gyro_random_walk = 1.9393e-5;
  double accel_noise_density = 2.0e-3;
  double accel_random_walk = 3.0e-4;
  double gyro_bias = 7e-4;
  double accel_bias = 4e-2;
  double scale_error = 1e-3;
  double misalignment_deg = 0.05;
  double gyro_range = 17.45;
  double accel_range = 176.0;
  bool earth_rotation = false;
  double latitude_deg = 59.0;

  /// Takes the numbers of a class of devices.
  void use(ImuPreset other);

  template <typename V>
  void visit(V& v) {
    using config::Range;
    v("enabled", enabled, "whether the vehicle has one");
    const ImuPreset before = preset;
    v("preset", preset,
      config::Choices<ImuPreset>{{"ideal", ImuPreset::ideal},
                                 {"tactical", ImuPreset::tactical},
                                 {"mems", ImuPreset::mems},
                                 {"consumer", ImuPreset::consumer}},
      "class of device; the keys below replace single numbers of it");
    if (preset != before) use(preset);
    v("rate_hz", rate_hz, Range{10.0, 2000.0}, "sample rate [Hz]");
    v("gyro_noise_density", gyro_noise_density, Range{0.0, 1.0}, "[rad/s/sqrt(Hz)]");
    v("gyro_random_walk", gyro_random_walk, Range{0.0, 1.0}, "[rad/s²/sqrt(Hz)]");
    v("accel_noise_density", accel_noise_density, Range{0.0, 10.0}, "[m/s²/sqrt(Hz)]");
    v("accel_random_walk", accel_random_walk, Range{0.0, 10.0}, "[m/s³/sqrt(Hz)]");
    v("gyro_bias", gyro_bias, Range{0.0, 1.0}, "turn-on bias, one sigma of an axis [rad/s]");
    v("accel_bias", accel_bias, Range{0.0, 10.0}, "turn-on bias, one sigma of an axis [m/s²]");
    v("scale_error", scale_error, Range{0.0, 0.2}, "of each axis, one sigma, 0.01 is 1 %");
    v("misalignment_deg", misalignment_deg, Range{0.0, 10.0}, "between axes, one sigma [deg]");
    v("gyro_range", gyro_range, Range{0.1, 1e6}, "readings clip here [rad/s]");
    v("accel_range", accel_range, Range{11.0, 1e6}, "readings clip here [m/s²]");
    v("earth_rotation", earth_rotation, "the world turns with the earth (x east, y north)");
    v("latitude_deg", latitude_deg, Range{-90.0, 90.0}, "where [deg]");
  }
};

/// Readings and, index by index, what is true: the instant, the motion, and the biases in the
/// reading (scale and misalignment are not in them).
struct ImuRecord {
  std::vector<ImuSample> samples;
  std::vector<Motion> truth;
  std::vector<Eigen::Vector3d> gyro_bias;   ///< [rad/s]
  std::vector<Eigen::Vector3d> accel_bias;  ///< [m/s²]
};

/// Readings of an IMU at the body's origin from `start` for `duration_s`. Specific force is
/// R^T (a - g), from the exact derivatives of the curve.
ImuRecord simulate_imu(const Se3Spline& spline, const ImuSimConfig& config,
                       const EventSchedule& events, Stamp start, double duration_s, double gravity,
                       std::uint64_t seed);

}  // namespace apvi::sim
