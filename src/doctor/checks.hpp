// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "doctor/image_pairs.hpp"
#include "doctor/observations.hpp"
#include "doctor/report.hpp"

/// Each function checks one aspect of the observations and adds its findings to the report.
namespace apvi::doctor {

struct CheckInput {
  Observations observed;
  Rig rig;
  bool has_rig = false;                             ///< false: checks against the rig are skipped
  std::vector<std::vector<ImagePair>> image_pairs;  ///< of each camera of the rig
  std::vector<double>
      static_shares;  ///< of the images of each camera, which the rig has no mask for
};

/// Missing sensors, rates, gaps, jitter, dropped and repeated samples, time overlap.
void check_timing(const CheckInput& c, Report& report);
/// Magnitude and direction of gravity, units of the gyro.
void check_imu(const CheckInput& c, Report& report);
/// Validity, dropouts, zeros, units, figure of merit.
void check_dvl(const CheckInput& c, Report& report);
/// Consistency of the four beams with each other and with the velocity vector.
void check_beams(const CheckInput& c, Report& report);
/// Units, sign, resolution and spikes of pressure and depth.
void check_depth(const CheckInput& c, Report& report);
/// Size of the first image against the intrinsics; parts of the images that never change.
void check_cameras(const CheckInput& c, Report& report);
/// Consistency between sensors: gyro, accelerometer, DVL, depth, reference.
void check_motion(const CheckInput& c, Report& report);
/// Time offset, rotation and lens of the cameras, and the scale of the gyro: rotation of the images
/// against that of the gyro.
void check_camera_motion(const CheckInput& c, Report& report);

}  // namespace apvi::doctor
