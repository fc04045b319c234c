// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "imu/propagation.hpp"

namespace apvi::vio {

enum class Status {
  waiting,   ///< not initialized
  started,   ///< initialized at this frame
  tracking,  ///< normal operation
  blind,     ///< no landmark in the graph: inertial (and DVL) propagation only
  frozen,    ///< older frames are held fixed, the state prior supplies the poses
  lost,      ///< failed at this frame; re-initializes at the next
};
std::string_view to_string(Status status);

/// Result of one frame.
struct Result {
  Stamp stamp;
  Status status = Status::waiting;
  std::string detail = {};  ///< what initialization is waiting for, or the reason of a failure
  imu::NavState state = {};
  /// Poses of frames before this one that an initialization without a DVL found, in order of time.
  std::vector<StampedPose> earlier = {};
  /// Of images alone: positions, landmarks and informations are in an unknown unit.
  bool up_to_scale = false;
  /// Marginal information of the newest pose; tangent [rotation, position].
  Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
  /// The same with the oldest pose held fixed: information about the motion over the window. Zero
  /// with one frame.
  Eigen::Matrix<double, 6, 6> window_information = Eigen::Matrix<double, 6, 6>::Zero();
  double window_s = 0.0;  ///< time from the oldest to the newest frame [s]
  int landmarks = 0;      ///< landmarks in the graph
  int observations = 0;
  double reprojection_rms_px = 0.0;  ///< over the observations of the newest frame
  bool keyframe = false;
  double solve_s = 0.0;
  double information_s = 0.0;
  double marginalize_s = 0.0;

  bool has_state() const { return status != Status::waiting && status != Status::lost; }
};

}  // namespace apvi::vio
