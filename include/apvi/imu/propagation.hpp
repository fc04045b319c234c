// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "apvi/geometry/se3.hpp"
#include "apvi/imu/noise.hpp"

namespace apvi::imu {

/// The state of the paper's Eq. (1): velocity is in the body frame.
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

/// What the world does to an inertial sensor.
struct World {
  Eigen::Vector3d gravity = Eigen::Vector3d(0.0, 0.0, -9.80665);  ///< [m/s²]
  Eigen::Vector3d earth_rate = Eigen::Vector3d::Zero();           ///< in world coordinates [rad/s]
};

/// One step of the motion equations of the paper's Eq. (2) over `dt` [s] with angular rate `gyro`
/// and specific force `accel` constant over it (give the mean of the samples at both ends: the
/// midpoint rule). Strapdown equations in a level frame on the turning Earth: Groves, "Principles
/// of GNSS, inertial, and multisensor integrated navigation systems", 2013, section 5.4, with the
/// transport rate left out (a vehicle at 2 m/s turns by 3e-7 rad/s over the globe).
NavState propagate(const NavState& state, const Eigen::Vector3d& gyro, const Eigen::Vector3d& accel,
                   double dt, const World& world);

/// The same with F = d result / d state (error states), exact for the discrete step. The columns of
/// the biases are also, up to sign, the effect of white noise on the sample.
NavState propagate(const NavState& state, const Eigen::Vector3d& gyro, const Eigen::Vector3d& accel,
                   double dt, const World& world, NavMatrix& F);

/// Covariance added by sensor noise in one step with the Jacobian `F` of `propagate`.
NavMatrix process_noise(const NavMatrix& F, const Noise& noise, double dt);

}  // namespace apvi::imu
