// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <optional>

#include "apvi/geometry/se3.hpp"
#include "imu/propagation.hpp"

namespace apvi::vio {

/// Parameter block of a pose: position [m], then the quaternion x y z w. Its tangent is [rotation,
/// position] with R Exp(θ), p + δ (as imu::NavIndex). Cost functions write the derivative by the
/// tangent to the first six of the seven columns and zero to the last.
using PoseBlock = std::array<double, 7>;
inline constexpr int kPoseSize = 7;
inline constexpr int kPoseTangent = 6;

/// Parameter block of velocity and biases: velocity in the world [m/s], gyro bias [rad/s],
/// accelerometer bias [m/s²].
using MotionBlock = std::array<double, 9>;
inline constexpr int kMotionSize = 9;

/// Parameter block of a lens correction: logarithm of the true over the rig's focal length, and the
/// shift of the principal point, in focal lengths. A point p on the plane z = 1 by the rig's lens
/// is truly at (p - shift) / ratio.
using LensBlock = std::array<double, 3>;
inline constexpr int kLensSize = 3;

/// How the body moves at a frame, for images that were taken some milliseconds before or after it.
struct ImageMotion {
  Eigen::Vector3d rate = Eigen::Vector3d::Zero();      ///< in the body frame [rad/s]
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< in the body frame [m/s]
  double compensated_s = 0.0;  ///< the part of the time offset that the frame's stamp contains

  /// T_frame_image of the body, for the time offset of the camera.
  SE3 shift(double offset_s) const;
};

inline SE3 to_se3(const double* pose) {
  return {Eigen::Map<const Eigen::Quaterniond>(pose + 3), Eigen::Map<const Eigen::Vector3d>(pose)};
}
PoseBlock to_block(const SE3& pose);

/// The state of the vehicle at one frame.
struct FrameState {
  PoseBlock pose{0, 0, 0, 0, 0, 0, 1};
  MotionBlock motion{};
};

/// `imu::NavState` stores the velocity in the body frame, the graph in the world frame.
FrameState to_frame_state(const imu::NavState& state);
imu::NavState to_nav_state(const FrameState& state);

/// Linearization points (first-estimate Jacobians: Huang, Mourikis, Roumeliotis, "A first-estimates
/// Jacobian EKF for improving SLAM consistency", 2009). A state in the marginalization prior keeps
/// the value it had when it entered, so that all Jacobians use the same value and no spurious
/// information appears in unobservable directions.
struct FirstEstimate {
  std::optional<PoseBlock> pose;
  std::optional<MotionBlock> motion;
};

}  // namespace apvi::vio
