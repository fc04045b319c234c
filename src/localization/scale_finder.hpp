// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>

#include "apvi/geometry/trajectory.hpp"
#include "apvi/localization/system.hpp"
#include "apvi/sensors/rig.hpp"
#include "localization/active_sensors.hpp"
#include "localization/dvl_scale.hpp"
#include "localization/pressure_scale.hpp"
#include "vio/result.hpp"

namespace apvi::localization {

/// The scale that visual-inertial odometry shows, and the shift that moves its poses to those by
/// images alone in meters.
struct VioScale {
  ScaleFound found;
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();
};

/// Finds the scale of poses by images alone: by a DVL without an IMU, by the depth, or by
/// visual-inertial odometry once that is initialized. The first pose stays where it is.
class ScaleFinder {
 public:
  ScaleFinder(const Rig& rig, const ActiveSensors& sensors);

  void add(const vio::DvlMeasurement& ping);
  void add(const vio::PressureDepthMeasurement& depth);
  /// A result by images alone. Returns the scale when DVL or depth show it now.
  std::optional<ScaleFound> add(const vio::Result& by_images);
  /// Compares the frames before the start of visual-inertial odometry, which both know.
  std::optional<VioScale> compare(const vio::Result& started) const;

  /// Whether there are poses whose scale is unknown.
  bool is_waiting() const { return first_.has_value(); }
  /// The stamp of the first of them.
  Stamp since() const { return first_->stamp; }
  /// Those poses stay up to scale.
  void give_up() {
    began_ = true;
    first_.reset();
  }

 private:
  void remember(const vio::Result& by_images);
  ScaleFound found(ScaleSensor by, double scale) const;

  Eigen::Vector3d p_body_camera_;
  std::optional<DvlScale> dvl_;
  std::optional<PressureScale> pressure_;
  bool began_ = false;                // the scale has been looked for
  std::optional<StampedPose> first_;  // of the run's poses, until the scale is known
  std::deque<StampedPose> recent_;    // of the last seconds
};

}  // namespace apvi::localization
