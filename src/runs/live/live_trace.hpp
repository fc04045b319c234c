// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "localization/fusion_stage.hpp"
#include "viewer/scene.hpp"

namespace apvi::runs {

/// The path of a run for its watchers: the odometry, moved onto the keyframes of the map, whose
/// loops are closed.
class LiveTrace {
 public:
  /// The next pose of the odometry.
  void add(const StampedPose& pose, const std::string& state);
  /// What a frame changes about earlier poses. False if nothing.
  bool rewrite(const localization::FrameOutput& output);
  /// Moves the path onto the keyframes (body poses). False, and nothing is moved, if no pose would
  /// move by a centimeter.
  bool follow(const Trajectory& keyframes);

  const std::vector<viewer::TracePose>& poses() const { return shown_; }

 private:
  std::vector<viewer::TracePose> odometry_;
  std::vector<viewer::TracePose> shown_;
  SE3 newest_;  // correction of the newest pose
};

}  // namespace apvi::runs
