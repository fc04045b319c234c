// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/measurements.hpp"

#include "apvi/geometry/so3.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using imu::kAccelBias;
using imu::kGyroBias;
using imu::kPosition;
using imu::kTheta;
using imu::kVelocity;

using Jacobian3 = Eigen::Matrix<double, 3, kSize>;

// Velocity of the DVL in the body frame.
Vector3d sensor_velocity(const State& x, const Vector3d& gyro) {
  return x.nav.v_body + (gyro - x.nav.gyro_bias).cross(x.p_body_dvl);
}

// Time derivative of the above in the rotating body frame.
Vector3d sensor_acceleration(const State& x, const Kinematics& k, const imu::EarthModel& world) {
  const Eigen::Quaterniond Rt = x.nav.R_world_body.conjugate();
  const Vector3d rate = k.gyro - x.nav.gyro_bias + Rt * world.earth_rate;
  return k.accel - x.nav.accel_bias + Rt * world.gravity - rate.cross(x.nav.v_body) +
         k.angular_acceleration.cross(x.p_body_dvl);
}

Jacobian3 dvl_jacobian(const State& x, const Kinematics& k, const imu::EarthModel& world) {
  const Matrix3d Rt = (1.0 + x.dvl_scale_error) * x.R_body_dvl.conjugate().toRotationMatrix();
  const Vector3d v_dvl = x.R_body_dvl.conjugate() * sensor_velocity(x, k.gyro);
  Jacobian3 H = Jacobian3::Zero();
  H.block<3, 3>(0, kVelocity) = Rt;
  H.block<3, 3>(0, kGyroBias) = Rt * so3::hat(x.p_body_dvl);
  H.col(kTimeOffset) = -Rt * sensor_acceleration(x, k, world);
  H.col(kScale) = v_dvl;
  H.block<3, 3>(0, kMounting) = (1.0 + x.dvl_scale_error) * so3::hat(v_dvl);
  H.block<3, 3>(0, kLeverArm) = Rt * so3::hat(k.gyro - x.nav.gyro_bias);
  return H;
}

}  // namespace

Vector3d predict_dvl(const State& x, const Vector3d& gyro) {
  return (1.0 + x.dvl_scale_error) * (x.R_body_dvl.conjugate() * sensor_velocity(x, gyro));
}

Measurement dvl_velocity(const State& x, const Kinematics& k, const imu::EarthModel& world,
                         const Vector3d& velocity, const Matrix3d& noise) {
  Measurement m(3);
  m.residual = velocity - predict_dvl(x, k.gyro);
  m.H = dvl_jacobian(x, k, world);
  m.R = noise;
  return m;
}

Matrix3d time_offset_noise(const Eskf& filter, const Kinematics& k, const imu::EarthModel& world) {
  const State& x = filter.state();
  const double offset_variance = filter.covariance()(kTimeOffset, kTimeOffset);
  if (offset_variance <= 0.0) return Matrix3d::Zero();
  // Jacobian of the sensor acceleration by the uncertain states.
  const Eigen::Quaterniond Rt = x.nav.R_world_body.conjugate();
  const Vector3d rate = k.gyro - x.nav.gyro_bias + Rt * world.earth_rate;
  Jacobian3 A = Jacobian3::Zero();
  A.block<3, 3>(0, kTheta) = so3::hat(Rt * world.gravity);
  A.block<3, 3>(0, kVelocity) = -so3::hat(rate);
  A.block<3, 3>(0, kGyroBias) = -so3::hat(x.nav.v_body);
  A.block<3, 3>(0, kAccelBias) = -Matrix3d::Identity();
  const Matrix3d acceleration =
      A * filter.covariance() * A.transpose() + k.accel_variance * Matrix3d::Identity();
  const Matrix3d R = x.R_body_dvl.toRotationMatrix();
  return offset_variance * R.transpose() * acceleration * R;
}

Measurement dvl_beam(const State& x, const Kinematics& k, const imu::EarthModel& world,
                     const Vector3d& beam, double velocity, double variance) {
  Measurement m(1);
  m.residual(0) = velocity - beam.dot(predict_dvl(x, k.gyro));
  m.H = beam.transpose() * dvl_jacobian(x, k, world);
  m.R(0, 0) = variance;
  return m;
}

Measurement dvl_displacement(const State& x, const Vector3d& displacement, const Matrix3d& noise) {
  Measurement m(3);
  const Matrix3d Rt = x.nav.R_world_body.conjugate().toRotationMatrix();
  const Vector3d predicted = Rt * (x.nav.p_world - x.p_last_ping);
  m.residual = displacement - predicted;
  m.H.block<3, 3>(0, kTheta) = so3::hat(predicted);
  m.H.block<3, 3>(0, kPosition) = Rt;
  m.H.block<3, 3>(0, kLastPing) = -Rt;
  m.R = noise;
  return m;
}

Measurement pressure_depth(const State& x, const Vector3d& p_body_sensor, double down_sign,
                           double depth_m, double variance) {
  Measurement m(1);
  const Matrix3d R = x.nav.R_world_body.toRotationMatrix();
  const double height = (x.nav.p_world + R * p_body_sensor).z();
  m.residual(0) = depth_m - (down_sign * height + x.depth_bias_m);
  m.H(0, kPosition + 2) = down_sign;
  m.H.block<1, 3>(0, kTheta) = -down_sign * (R * so3::hat(p_body_sensor)).row(2);
  m.H(0, kDepthBias) = 1.0;
  m.R(0, 0) = variance;
  return m;
}

Measurement zero_velocity(const State& x, double variance) {
  Measurement m(3);
  m.residual = -x.nav.v_body;
  m.H.block<3, 3>(0, kVelocity).setIdentity();
  m.R = variance * Matrix3d::Identity();
  return m;
}

}  // namespace apvi::dipo
