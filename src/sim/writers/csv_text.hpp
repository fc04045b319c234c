// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "sim/simulation.hpp"
#include "sim/spectral/development.hpp"

/// Formats sensor samples as CSV text. `header` is the first line without its line break.
namespace apvi::sim {

std::string imu_csv(const std::vector<ImuSample>& samples, std::string_view header);
/// This project's columns: velocity, figure of merit, altitude, validity, beams.
std::string dvl_csv(const std::vector<DvlSample>& samples);
std::string pressure_csv(const std::vector<PressureSample>& samples);
std::string depth_csv(const std::vector<PressureDepthSample>& samples);
std::string camera_csv(const std::vector<FrameTime>& frames, std::string_view header,
                       std::string_view extension);
/// Shutter time, ISO (100 times the gain) and white balance, as cameras report them.
std::string exposure_csv(const std::vector<FrameTime>& frames,
                         const std::vector<Development>& exposures, double shutter_s);
/// Stamp, position, quaternion wxyz, velocity, gyro bias, accelerometer bias.
std::string truth_csv(const ImuRecord& record, std::string_view header);

inline constexpr std::string_view kTruthHeader =
    "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w,q_x,q_y,q_z,v_x [m s^-1],v_y [m s^-1],"
    "v_z [m s^-1],b_w_x [rad s^-1],b_w_y [rad s^-1],b_w_z [rad s^-1],b_a_x [m s^-2],b_a_y [m s^-2],"
    "b_a_z [m s^-2]";

}  // namespace apvi::sim
