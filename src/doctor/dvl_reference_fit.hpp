// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "doctor/dvl_imu_fit.hpp"

namespace apvi::doctor {

/// Dead reckoning with the reference's attitude against the reference's displacements over 30, 60
/// and 100 s. Such baselines see the DVL's timing as the trajectory does: through where side-slip
/// and changes of speed fall in the turns.
struct DvlReferenceFit {
  double time_offset_s = 0.0;  ///< by how much the DVL's stamps are late
  double time_offset_sigma_s = 0.0;
  double scale = 1.0;    ///< true over reported velocity, beyond the rig's
  double yaw_rad = 0.0;  ///< to turn the velocity by, about the vertical
  Eigen::Vector3d lever_arm = Eigen::Vector3d::Zero();  ///< that the fit used [m]
  bool lever_arm_is_rigs = true;  ///< false: free, because the rig's does not fit
  double rms = 0.0;               ///< of a displacement [m]
  double rms_as_rig = 0.0;        ///< the same with the rig's time offset
};

/// Nothing when the reference has no attitude or shares less than two minutes with DVL and IMU.
std::optional<DvlReferenceFit> fit_dvl_against_reference(const InertialPath& path,
                                                         const std::vector<DvlPing>& pings,
                                                         const DvlMounting& rig,
                                                         const Trajectory& reference);

}  // namespace apvi::doctor
