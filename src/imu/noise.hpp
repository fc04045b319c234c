// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace apvi::imu {

/// Continuous-time noise model of an IMU.
struct Noise {
  double gyro = 1e-3;        ///< white noise density [rad/s/sqrt(Hz)]
  double accel = 1e-2;       ///< white noise density [m/s²/sqrt(Hz)]
  double gyro_walk = 1e-5;   ///< bias random walk [rad/s²/sqrt(Hz)]
  double accel_walk = 1e-4;  ///< bias random walk [m/s³/sqrt(Hz)]
};

// Assumed turn rate and acceleration during a gap in the inertial data, one sigma.
inline constexpr double kGapTurnRate = 0.2;      // [rad/s]
inline constexpr double kGapAcceleration = 0.3;  // [m/s²]

}  // namespace apvi::imu
