// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/se3.hpp"
#include "imu/noise.hpp"

namespace apvi::imu {

/// Navigation state, Eq. (1) of the paper; the velocity is in the body frame.
struct NavState {
  Eigen::Quaterniond R_world_body = Eigen::Quaterniond::Identity();
  Eigen::Vector3d p_world = Eigen::Vector3d::Zero();     ///< [m]
  Eigen::Vector3d v_body = Eigen::Vector3d::Zero();      ///< over ground [m/s]
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();   ///< [rad/s]
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();  ///< [m/s²]

  SE3 pose() const { return {R_world_body, p_world}; }
};

/// Order of the error state: R_true = R Exp(θ), every other part adds.
enum NavIndex { kTheta = 0, kPosition = 3, kVelocity = 6, kGyroBias = 9, kAccelBias = 12 };
inline constexpr int kNavSize = 15;
using NavVector = Eigen::Matrix<double, kNavSize, 1>;
using NavMatrix = Eigen::Matrix<double, kNavSize, kNavSize>;

NavState boxplus(const NavState& state, const NavVector& delta);
/// The δ with boxplus(b, δ) = a.
NavVector boxminus(const NavState& a, const NavState& b);

/// Gravity and Earth rotation as they affect an IMU.
struct EarthModel {
  Eigen::Vector3d gravity = Eigen::Vector3d(0.0, 0.0, -kStandardGravity);  ///< [m/s²]
  Eigen::Vector3d earth_rate = Eigen::Vector3d::Zero();  ///< in world coordinates [rad/s]
};

/// Integrates the motion equations, Eq. (2) of the paper, over `dt` [s] with constant angular rate
/// `gyro` and specific force `accel` (pass the mean of the samples at both ends: midpoint rule).
/// Strapdown equations in a local-level frame on the rotating Earth: Groves, "Principles of GNSS,
/// inertial, and multisensor integrated navigation systems", 2013, section 5.4, without the
/// transport rate (3e-7 rad/s for a vehicle at 2 m/s).
NavState propagate(const NavState& state, const Eigen::Vector3d& gyro, const Eigen::Vector3d& accel,
                   double dt, const EarthModel& world);

/// The same, with F = d result / d state (error states), exact for the discrete step. The bias
/// columns are also, up to sign, the Jacobian with respect to white noise on the sample.
NavState propagate(const NavState& state, const Eigen::Vector3d& gyro, const Eigen::Vector3d& accel,
                   double dt, const EarthModel& world, NavMatrix& F);

/// Process noise covariance of one step with the Jacobian `F` of `propagate`.
NavMatrix process_noise(const NavMatrix& F, const Noise& noise, double dt);

}  // namespace apvi::imu
