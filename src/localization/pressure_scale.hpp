// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/sensors/rig.hpp"
#include "vio/window/window.hpp"

namespace apvi::localization {

/// The scale of poses by images alone from depths below the surface. With the position c of the
/// camera in its unit, the depth of the sensor is
///
///     d = d0 + n · c + z · R l,    n = s (z + h),    h ⊥ z,
///
/// with the scale s, the assumed direction z of gravity, its error h, and l from the camera to the
/// sensor. Least squares gives n and d0, with h ~ N(0, tilt_sigma²); s = |n|. Without a prior on h,
/// a path along a line does not show s; with it, changes of depth must exceed tilt_sigma times the
/// horizontal path.
class PressureScale {
 public:
  /// `tilt_sigma`: error of the vertical of the poses [rad].
  PressureScale(const Rig& rig, double tilt_sigma);

  void add(const vio::PressureDepthMeasurement& depth);
  /// The next pose. Returns the scale [m per unit] once it is known to a few percent.
  std::optional<double> add(const StampedPose& pose);
  /// Forgets everything, as when images start anew.
  void reset();

 private:
  void compare(const vio::PressureDepthMeasurement& depth);
  std::optional<double> solve() const;

  Eigen::Vector3d down_;
  Eigen::Vector3d p_body_camera_;
  Eigen::Vector3d camera_to_sensor_;  // in the body
  double tilt_sigma_;
  std::deque<vio::PressureDepthMeasurement> depths_;
  Trajectory recent_;                                   // the last poses
  std::optional<vio::PressureDepthMeasurement> first_;  // compared
  Stamp last_;
  int count_ = 0;
  double sigma_m_ = 0.0;  // largest of a measurement
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  Eigen::Matrix4d AtA_ = Eigen::Matrix4d::Zero();  // of [c - origin, 1]
  Eigen::Vector4d Aty_ = Eigen::Vector4d::Zero();
  double yty_ = 0.0;
};

}  // namespace apvi::localization
