// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "doctor/inertial_path.hpp"
#include "doctor/observations.hpp"

namespace apvi::doctor {

/// How a DVL sits and ticks against the IMU, by the data alone.
///
/// The IMU's velocity is v(t) = M d(t + o) - ω(t) x l with the reported velocity d, the mounting M,
/// the lever arm l and the stamps' lateness o. Over a second or so its change must be what the
/// accelerometer felt less gravity. For a given o that is linear in M, l and the accelerometer's
/// bias; gravity is free in every 20 s, with a slope that takes up the gyro's drift, so no attitude
/// is needed. o is scanned.
struct DvlImuFit {
  double time_offset_s = 0.0;  ///< by how much the DVL's stamps are late
  double time_offset_sigma_s = 0.0;
  /// From reported components to the body frame: a rotation, or a rotation and a reflection when
  /// the reported axes are left-handed. Without scale.
  Eigen::Matrix3d mounting = Eigen::Matrix3d::Identity();
  Eigen::Vector3d mounting_sigma = Eigen::Vector3d::Zero();  ///< about the body's axes [rad]
  bool mounting_is_free = false;  ///< found without the rig's help (enough motion for that)
  Eigen::Vector3d lever_arm = Eigen::Vector3d::Zero();  ///< DVL in the body frame [m]
  Eigen::Vector3d lever_arm_sigma = Eigen::Vector3d::Zero();
  /// True over reported velocity lies between these: all noise in the DVL, all noise in the IMU.
  double scale_low = 1.0;
  double scale_high = 1.0;
  double rms = 0.0;         ///< of a change of velocity [m/s]
  double rms_as_rig = 0.0;  ///< the same with the rig's mounting, lever arm and time offset
  std::size_t pairs = 0;
};

/// What the rig says: reported components to the body frame with scale, lever arm, time offset.
struct DvlMounting {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
  Eigen::Vector3d lever_arm = Eigen::Vector3d::Zero();
  double time_offset_s = 0.0;
};

/// Nothing when there is too little data or motion to tell.
std::optional<DvlImuFit> fit_dvl_against_imu(const InertialPath& path,
                                             const std::vector<DvlPing>& pings,
                                             const DvlMounting& rig);

}  // namespace apvi::doctor
