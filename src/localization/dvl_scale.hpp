// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/rig.hpp"
#include "vio/window/window.hpp"

namespace apvi::localization {

/// The scale of poses by images alone from DVL velocities, without an IMU: with the velocity v of
/// the camera in its unit, that of the DVL is s v + ω x l, l from the camera to the DVL, and s
/// follows by least squares.
class DvlScale {
 public:
  DvlScale(const DvlCalibration& dvl, const Eigen::Vector3d& p_body_camera)
      : R_body_dvl_(dvl.T_body_dvl.rotation),
        p_body_camera_(p_body_camera),
        camera_to_dvl_(dvl.T_body_dvl.translation - p_body_camera) {}

  void add(const vio::DvlMeasurement& ping);
  /// The next pose. Returns the scale [m per unit] once it is known to a few percent.
  std::optional<double> add(const StampedPose& pose);
  /// Forgets everything, as when images start anew.
  void reset();

 private:
  void compare(const vio::DvlMeasurement& ping);

  Eigen::Quaterniond R_body_dvl_;
  Eigen::Vector3d p_body_camera_;
  Eigen::Vector3d camera_to_dvl_;  // in the body
  std::deque<vio::DvlMeasurement> pings_;
  Trajectory recent_;  // of the last seconds
  int count_ = 0;      // pings compared
  double vv_ = 0.0;    // sums of products of the velocities by images and by the DVL
  double vm_ = 0.0;
  double mm_ = 0.0;
};

}  // namespace apvi::localization
