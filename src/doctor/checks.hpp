// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/doctor/report.hpp"
#include "doctor/observations.hpp"

/// Each judges one aspect of what was observed and adds its findings.
namespace apvi::doctor {

struct Case {
  Observations seen;
  Rig rig;
  bool has_rig = false;  ///< false: nothing may be said about what the rig claims
};

/// Sensors that never report, rates, gaps, jitter, dropped and repeated samples, common time.
void check_timing(const Case& c, Report& report);
/// Gravity's size and direction, units of the gyro.
void check_imu(const Case& c, Report& report);
/// Validity, dropouts, zeros, units, figure of merit.
void check_dvl(const Case& c, Report& report);
/// Parity of the four beams, and beams against the velocity vector.
void check_beams(const Case& c, Report& report);
/// Units, sign, resolution and spikes of pressure and depth.
void check_depth(const Case& c, Report& report);
/// Size of the first image against the intrinsics.
void check_cameras(const Case& c, Report& report);
/// The sensors against each other: gyro, accelerometer, DVL, depth, reference.
void check_motion(const Case& c, Report& report);

}  // namespace apvi::doctor
