// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "doctor/inertial_path.hpp"
#include "doctor/observations.hpp"

namespace apvi::doctor {

/// Extrinsic and temporal calibration of a DVL relative to the IMU, from motion alone.
///
/// The IMU's velocity is v(t) = M d(t + o) - ω(t) x l with the reported velocity d, the mounting M,
/// the lever arm l and the delay o of the stamps. Over about a second its change must equal the
/// integrated specific force minus gravity. For given o this is linear in M, l and the
/// accelerometer bias; gravity is estimated per 20 s block, with a slope that absorbs gyro drift,
/// so no attitude is needed. o is found by a scan.
struct DvlImuFit {
  double time_offset_s = 0.0;  ///< delay of the DVL's stamps
  double time_offset_sigma_s = 0.0;
  /// From reported components to the body frame: a rotation, or a rotation and a reflection when
  /// the reported axes are left-handed. Without scale.
  Eigen::Matrix3d mounting = Eigen::Matrix3d::Identity();
  Eigen::Vector3d mounting_sigma = Eigen::Vector3d::Zero();  ///< about the body axes [rad]
  bool mounting_is_observable = false;  ///< enough motion to estimate it without the rig
  Eigen::Vector3d lever_arm = Eigen::Vector3d::Zero();  ///< DVL in the body frame [m]
  Eigen::Vector3d lever_arm_sigma = Eigen::Vector3d::Zero();
  /// Bounds of true over reported velocity: all noise in the DVL, all noise in the IMU.
  double scale_low = 1.0;
  double scale_high = 1.0;
  double rms = 0.0;           ///< of the velocity changes [m/s]
  double rms_with_rig = 0.0;  ///< with the rig's mounting, lever arm and time offset
  std::size_t pairs = 0;
};

/// The rig's calibration: reported components to the body frame with scale, lever arm, time offset.
struct DvlMounting {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
  Eigen::Vector3d lever_arm = Eigen::Vector3d::Zero();
  double time_offset_s = 0.0;
};
/// Identity for a rig without a DVL.
DvlMounting mounting_of(const Rig& rig);

/// Empty when there is too little data or motion.
std::optional<DvlImuFit> fit_dvl_against_imu(const InertialPath& path,
                                             const std::vector<DvlPing>& pings,
                                             const DvlMounting& rig);

}  // namespace apvi::doctor
