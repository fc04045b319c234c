// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "dipo/eskf.hpp"

/// Measurement equations of the sensors, with Jacobians with respect to the error state of `State`.
/// The state is that at the time of the measurement; `gyro` is the raw sample at that time [rad/s].
namespace apvi::dipo {

/// Motion of the body at the time of a DVL ping.
struct Kinematics {
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();                  ///< raw [rad/s]
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();                 ///< raw specific force [m/s²]
  Eigen::Vector3d angular_acceleration = Eigen::Vector3d::Zero();  ///< [rad/s²]
  double accel_variance = 0.0;  ///< per component of `accel` [m²/s⁴]
};

/// Predicted DVL velocity in the DVL frame, as reported: (1 + s) R_BDᵀ (v + (ω - b_g) x p_BD).
/// Independent of attitude, so it adds no spurious yaw information.
Eigen::Vector3d predict_dvl(const State& x, const Eigen::Vector3d& gyro);

/// The paper's Eq. (3), first part. `velocity` as reported [m/s], `noise` its covariance [m²/s²].
/// The time offset enters through the acceleration of the sensor: the state is that at stamp -
/// offset.
Measurement dvl_velocity(const State& x, const Kinematics& k, const imu::EarthModel& world,
                         const Eigen::Vector3d& velocity, const Eigen::Matrix3d& noise);

/// Covariance of the second-order term that the linearization of `dvl_velocity` neglects [m²/s²],
/// in the DVL frame: the error of the time offset times the error of the acceleration. Both may be
/// large at the start; without this term the filter becomes overconfident in the offset (Jazwinski,
/// "Stochastic processes and filtering theory", 1970, section 9.3).
Eigen::Matrix3d time_offset_noise(const Eskf& filter, const Kinematics& k,
                                  const imu::EarthModel& world);

/// One beam, a unit vector in the DVL frame: beam . velocity. Usable with any number of beams in
/// lock.
Measurement dvl_beam(const State& x, const Kinematics& k, const imu::EarthModel& world,
                     const Eigen::Vector3d& beam, double velocity, double variance);

/// The paper's Eq. (3), second part: the displacement since the last ping in the current body
/// frame, R_iᵀ (p_i - p_{i-1}), against `displacement` [m]. The displacement is computed from two
/// velocities that dvl_velocity also uses, so the caller must inflate `noise`.
Measurement dvl_displacement(const State& x, const Eigen::Vector3d& displacement,
                             const Eigen::Matrix3d& noise);

/// Pressure depth of a sensor at `p_body_sensor`: `down_sign` (p + R p_BS)_z + bias. `down_sign` is
/// +1 if z points down, -1 if it points up.
Measurement pressure_depth(const State& x, const Eigen::Vector3d& p_body_sensor, double down_sign,
                           double depth_m, double variance);

/// The vehicle is stationary: v = 0.
Measurement zero_velocity(const State& x, double variance);

}  // namespace apvi::dipo
