// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "doctor/dvl_imu_fit.hpp"

namespace apvi::doctor {

/// Fit of dead reckoning with the reference's attitude to the reference's displacements over 30, 60
/// and 100 s. On these baselines the DVL's time offset has the same effect as on the trajectory.
struct DvlReferenceFit {
  double time_offset_s = 0.0;  ///< delay of the DVL's stamps
  double time_offset_sigma_s = 0.0;
  double scale = 1.0;    ///< true over reported velocity, after the rig's scale
  double yaw_rad = 0.0;  ///< correction of the velocity's direction, about the vertical
  Eigen::Vector3d lever_arm = Eigen::Vector3d::Zero();  ///< used by the fit [m]
  bool lever_arm_is_from_rig = true;  ///< false: estimated, because the rig's does not fit
  double rms = 0.0;                   ///< of the displacements [m]
  double rms_with_rig = 0.0;          ///< with the rig's time offset
};

/// Empty when the reference has no attitude or overlaps DVL and IMU for less than two minutes.
std::optional<DvlReferenceFit> fit_dvl_against_reference(const InertialPath& path,
                                                         const std::vector<DvlPing>& pings,
                                                         const DvlMounting& rig,
                                                         const Trajectory& reference);

}  // namespace apvi::doctor
