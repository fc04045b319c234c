// SPDX-License-Identifier: BSD-3-Clause
#include "imu/preintegration.hpp"

#include <cmath>

#include "apvi/core/error.hpp"
#include "apvi/geometry/so3.hpp"

namespace apvi::imu {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

namespace {

// Variance density of white noise that has the effect of an unknown constant `value` at the end of
// a gap: density² T = (value T)².
double with_gap(double noise_density, double value, double gap_s) {
  return noise_density * noise_density + value * value * gap_s;
}

}  // namespace

Preintegration::Preintegration(const Noise& noise, const Vector3d& gyro_bias,
                               const Vector3d& accel_bias)
    : noise_(noise), gyro_bias_(gyro_bias), accel_bias_(accel_bias) {}

void Preintegration::integrate(const ImuSample& from, const ImuSample& to, double gap_s) {
  APVI_CHECK(to.stamp > from.stamp);
  step(0.5 * (from.gyro + to.gyro) - gyro_bias_, 0.5 * (from.accel + to.accel) - accel_bias_,
       seconds_between(from.stamp, to.stamp), gap_s);
}

void Preintegration::step(const Vector3d& gyro, const Vector3d& accel, double dt, double gap_s) {
  const Vector3d phi = gyro * dt;
  const Quaterniond R_mid = delta_.rotation * so3::exp(0.5 * phi);
  const Vector3d acceleration = R_mid * accel;

  // Jacobian of this step with respect to the error state before it.
  const Matrix3d force_mid = -R_mid.toRotationMatrix() * so3::hat(accel);
  const Matrix3d v_theta = dt * force_mid * so3::exp(-0.5 * phi).toRotationMatrix();
  const Matrix3d v_bg = -0.5 * dt * dt * force_mid * so3::right_jacobian(0.5 * phi);
  const Matrix3d v_ba = -dt * R_mid.toRotationMatrix();
  Matrix F = Matrix::Identity();
  F.block<3, 3>(kRotation, kRotation) = so3::exp(-phi).toRotationMatrix();
  F.block<3, 3>(kRotation, kGyroBias) = -dt * so3::right_jacobian(phi);
  F.block<3, 3>(kVelocity, kRotation) = v_theta;
  F.block<3, 3>(kVelocity, kGyroBias) = v_bg;
  F.block<3, 3>(kVelocity, kAccelBias) = v_ba;
  F.block<3, 3>(kPosition, kRotation) = 0.5 * dt * v_theta;
  F.block<3, 3>(kPosition, kVelocity) = dt * Matrix3d::Identity();
  F.block<3, 3>(kPosition, kGyroBias) = 0.5 * dt * v_bg;
  F.block<3, 3>(kPosition, kAccelBias) = 0.5 * dt * v_ba;

  delta_.position += delta_.velocity * dt + 0.5 * acceleration * dt * dt;
  delta_.velocity += acceleration * dt;
  delta_.rotation = (delta_.rotation * so3::exp(phi)).normalized();
  duration_s_ += dt;

  jacobian_ = F * jacobian_;
  covariance_ = F * covariance_ * F.transpose();
  const Eigen::Matrix<double, 9, 3> from_gyro = F.block<9, 3>(0, kGyroBias);
  const Eigen::Matrix<double, 9, 3> from_accel = F.block<9, 3>(0, kAccelBias);
  const double gyro_variance = with_gap(noise_.gyro, kGapTurnRate, gap_s) / dt;
  const double accel_variance = with_gap(noise_.accel, kGapAcceleration, gap_s) / dt;
  covariance_.topLeftCorner<9, 9>() += gyro_variance * from_gyro * from_gyro.transpose() +
                                       accel_variance * from_accel * from_accel.transpose();
  // Noise within the step: without it, position and velocity would move alike, and the covariance
  // of a single step would have no inverse.
  covariance_.diagonal().segment<3>(kPosition).array() += accel_variance * std::pow(dt, 4) / 12.0;
  covariance_.diagonal().segment<3>(kGyroBias).array() += noise_.gyro_walk * noise_.gyro_walk * dt;
  covariance_.diagonal().segment<3>(kAccelBias).array() +=
      noise_.accel_walk * noise_.accel_walk * dt;
}

Preintegration::Delta Preintegration::corrected(const Vector3d& gyro_bias,
                                                const Vector3d& accel_bias) const {
  Eigen::Matrix<double, 6, 1> change;
  change << gyro_bias - gyro_bias_, accel_bias - accel_bias_;
  const Eigen::Matrix<double, 9, 1> effect = bias_jacobian() * change;
  return {(delta_.rotation * so3::exp(effect.segment<3>(kRotation))).normalized(),
          delta_.velocity + effect.segment<3>(kVelocity),
          delta_.position + effect.segment<3>(kPosition)};
}

}  // namespace apvi::imu
