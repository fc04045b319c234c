// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "doctor/dvl_imu_fit.hpp"

namespace apvi::doctor {

/// Fit of the DVL's vertical velocity, rotated by the IMU attitude, to depth changes over 2 s.
struct DepthLag {
  double time_offset_s = 0.0;  ///< delay of the DVL's stamps relative to the depth sensor's
  double time_offset_sigma_s = 0.0;
  double correlation = 0.0;   ///< at that offset; negative when one sign is wrong
  double depth_change = 0.0;  ///< RMS of the depth changes [m]
};

/// `p_sensor` is the depth sensor's position in the body frame [m]. Empty when there is too little
/// data or the depth hardly changes.
std::optional<DepthLag> fit_dvl_against_depth(const InertialPath& path,
                                              const std::vector<DvlPing>& pings,
                                              const DvlMounting& rig,
                                              const std::vector<DepthPoint>& depths,
                                              const Eigen::Vector3d& p_sensor);

}  // namespace apvi::doctor
