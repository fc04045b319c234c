// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "apvi/dipo/eskf.hpp"

/// The sensors' measurement equations, with Jacobians with respect to the error state of `State`.
/// The state is that of the measurement's own time; `gyro` is the raw sample then [rad/s].
namespace apvi::dipo {

/// What the body does at the instant of a DVL ping.
struct Kinematics {
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();                  ///< raw [rad/s]
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();                 ///< raw specific force [m/s²]
  Eigen::Vector3d angular_acceleration = Eigen::Vector3d::Zero();  ///< [rad/s²]
  double accel_variance = 0.0;  ///< of a component of `accel` [m²/s⁴]
};

/// Velocity of the DVL in its own frame as it would be reported: (1 + s) R_BDᵀ (v + (ω - b_g) x
/// p_BD). No attitude appears, so yaw is never observed falsely.
Eigen::Vector3d predict_dvl(const State& x, const Eigen::Vector3d& gyro);

/// The paper's Eq. (3), first part. `velocity` as reported [m/s], `noise` the covariance [m²/s²].
/// The time offset enters through the sensor's acceleration: the state is that of stamp - offset.
Measurement dvl_velocity(const State& x, const Kinematics& k, const imu::World& world,
                         const Eigen::Vector3d& velocity, const Eigen::Matrix3d& noise);

/// Covariance of what the linearisation leaves out of `dvl_velocity` [m²/s²]: the offset's error
/// times the error of the acceleration that multiplies it, both of which may be large at the start.
/// Without it the filter takes the product for knowledge of the offset (the second-order term of
/// Jazwinski, "Stochastic processes and filtering theory", 1970, section 9.3). In the DVL frame.
Eigen::Matrix3d time_offset_noise(const Eskf& filter, const Kinematics& k, const imu::World& world);

/// One beam, a unit vector in the DVL frame: beam . velocity. Works with any number of beams in
/// lock.
Measurement dvl_beam(const State& x, const Kinematics& k, const imu::World& world,
                     const Eigen::Vector3d& beam, double velocity, double variance);

/// The paper's Eq. (3), second part: displacement since the last ping in the body frame at this
/// one, R_iᵀ (p_i - p_{i-1}) against `displacement` [m]. Its noise is that of the two velocities it
/// was made of; the caller inflates `noise` because they are used in dvl_velocity too.
Measurement dvl_displacement(const State& x, const Eigen::Vector3d& displacement,
                             const Eigen::Matrix3d& noise);

/// Depth of a sensor at `p_body_sensor`: `depth_sign` (p + R p_BS)_z + bias; sign +1 when z is
/// down.
Measurement depth(const State& x, const Eigen::Vector3d& p_body_sensor, double depth_sign,
                  double depth_m, double variance);

/// The vehicle stands still: v = 0.
Measurement zero_velocity(const State& x, double variance);
/// The vehicle does not turn: the gyro reads its bias and the Earth's rate.
Measurement zero_rate(const State& x, const Eigen::Vector3d& gyro, const imu::World& world,
                      double variance);
/// The vehicle stands still: the accelerometer reads its bias and gravity.
Measurement zero_acceleration(const State& x, const Eigen::Vector3d& accel, const imu::World& world,
                              double variance);

}  // namespace apvi::dipo
