// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "doctor/dvl_imu_fit.hpp"

namespace apvi::doctor {

/// The DVL's vertical velocity, levelled by the IMU, against changes of depth over two seconds.
struct DepthLag {
  double time_offset_s = 0.0;  ///< by how much the DVL's stamps are late against the depth sensor's
  double time_offset_sigma_s = 0.0;
  double correlation = 0.0;   ///< at that offset; negative when one of them has the wrong sign
  double depth_change = 0.0;  ///< rms of the changes [m]
};

/// `p_sensor` is the depth sensor in the body frame [m]. Nothing when there is too little data or
/// the depth hardly changes.
std::optional<DepthLag> fit_dvl_against_depth(const InertialPath& path,
                                              const std::vector<DvlPing>& pings,
                                              const DvlMounting& rig,
                                              const std::vector<DepthPoint>& depths,
                                              const Eigen::Vector3d& p_sensor);

}  // namespace apvi::doctor
