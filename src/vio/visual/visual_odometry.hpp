// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/geometry/scale_change.hpp"
#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"
#include "apvi/vio/config.hpp"
#include "core/condition_timer.hpp"
#include "vio/result.hpp"
#include "vio/window/window.hpp"

namespace apvi::vio {

struct VisualStart;

/// Odometry by the images of the first camera alone, up to scale: used without an IMU, and until
/// visual-inertial odometry knows the scale. The sliding window is that of `Estimator` without
/// inertial terms. Lengths are in units in which the median distance of the first scene is
/// `VisualConfig::start_distance`. The prior of the first window holds its first pose and the
/// length of its path; marginalization carries both on.
///
/// The world is leveled by the mean specific force of the start, if there is an IMU. Otherwise the
/// vehicle is taken to be level at its first pose; if the body frame is the camera's, the first
/// image is taken to be upright. Yaw and position of the first pose are zero.
class VisualOdometry {
 public:
  VisualOdometry(const Config& config, const Rig& rig);
  VisualOdometry(const VisualOdometry&) = delete;  // window_.prior points into the window
  VisualOdometry& operator=(const VisualOdometry&) = delete;

  /// Samples up to the next frame; used for leveling only.
  void add(const ImuSample& sample);

  /// Processes one frame. When the start succeeds, the result has the poses of earlier frames. A
  /// start after a loss continues at the position and heading of `last_pose`, in a unit in which
  /// the median distance of the scene is unchanged.
  Result process(const TrackedFrame& tracked, const std::optional<SE3>& last_pose);
  void reset();
  /// Another estimator gives the poses, in meters; a start after its loss takes the distance to the
  /// scene from its window.
  void follow(const Window& metric);
  /// Changes the unit of length to meters.
  void change_scale(const ScaleChange& to_meters);

  bool started() const { return !window_.frames.empty(); }
  const Window& window() const { return window_; }

 private:
  Result start(const TrackedFrame& tracked, const std::optional<SE3>& last_pose);
  void collect(const TrackedFrame& tracked);
  void begin(VisualStart found, const std::optional<SE3>& last_pose, Result& result);
  Result track(const TrackedFrame& tracked);
  Eigen::Vector3d up_force(const std::vector<std::optional<SE3>>& poses) const;
  void forget_old_frames(Stamp newest);
  void finish(Result& result, int iterations);
  std::shared_ptr<const Prior> changed(const Prior& prior, const ScaleChange& to_meters) const;

  Config config_;
  Rig rig_;
  Eigen::Vector3d p_body_camera_;
  Window window_;
  std::vector<TrackedFrame> waiting_;        // frames collected for the start
  std::vector<Eigen::Vector3d> mean_force_;  // before each of them [m/s²]; zero without an IMU
  Eigen::Vector3d force_sum_ = Eigen::Vector3d::Zero();
  int force_count_ = 0;
  int attempts_ = 0;
  std::string waiting_for_;
  double scene_depth_;      // median depth in the last window
  bool is_metric_ = false;  // after `change_scale`
  bool newest_is_keyframe_ = false;
  ConditionTimer bad_;  // the reprojection error is too large
};

}  // namespace apvi::vio
