// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/core/stamp.hpp"
#include "apvi/geometry/se3.hpp"
#include "apvi/geometry/trajectory.hpp"

namespace apvi {

/// Pose, velocity and acceleration of a rigid body at one instant, exact derivatives of a spline.
struct Motion {
  SE3 T_world_body;
  Eigen::Vector3d velocity_world = Eigen::Vector3d::Zero();             ///< [m/s]
  Eigen::Vector3d acceleration_world = Eigen::Vector3d::Zero();         ///< [m/s²]
  Eigen::Vector3d angular_velocity_body = Eigen::Vector3d::Zero();      ///< [rad/s]
  Eigen::Vector3d angular_acceleration_body = Eigen::Vector3d::Zero();  ///< [rad/s²]
};

/// Uniform quintic B-spline over control poses: position in R³, cumulative rotation on SO(3); C4
/// continuous, so that simulated inertial data have no steps.
/// Derivatives by the recursion of Sommer et al., "Efficient derivative computation for cumulative
/// B-splines on Lie groups", CVPR 2020.
class Se3Spline {
 public:
  /// Needs at least six control poses, `period` apart, and a positive period.
  Se3Spline(Stamp start, Duration period, std::vector<SE3> control_poses);

  /// A spline through the poses of the trajectory at every `period`, from the first to the last.
  /// Throws InputError for a trajectory shorter than two periods.
  static Se3Spline through(const Trajectory& trajectory, Duration period);

  Stamp start() const { return start_; }
  Stamp end() const;
  /// `stamp` is clamped to [start, end].
  Motion at(Stamp stamp) const;

 private:
  Stamp start_;
  Duration period_;
  std::vector<SE3> control_;
};

}  // namespace apvi
