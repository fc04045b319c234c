// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "apvi/sensors/samples.hpp"
#include "imu/noise.hpp"

namespace apvi::imu {

/// Preintegrated IMU measurements between two states: Forster, Carlone, Dellaert, Scaramuzza,
/// "On-manifold preintegration for real-time visual-inertial odometry", T-RO 2017, with the
/// midpoint rule for angular rate and specific force.
///
/// With R, p, v (world frame velocity) at the ends i and j over the time T and gravity g:
///   ΔR = R_iᵀ R_j,  Δv = R_iᵀ (v_j - v_i - g T),  Δp = R_iᵀ (p_j - p_i - v_i T - g T²/2).
class Preintegration {
 public:
  /// Order of the error state: rotation (ΔR_true = ΔR Exp(θ)), velocity, position, then the biases.
  enum Index { kRotation = 0, kVelocity = 3, kPosition = 6, kGyroBias = 9, kAccelBias = 12 };
  static constexpr int kSize = 15;
  using Matrix = Eigen::Matrix<double, kSize, kSize>;

  struct Delta {
    Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< [m/s]
    Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< [m]
  };

  Preintegration(const Noise& noise, const Eigen::Vector3d& gyro_bias,
                 const Eigen::Vector3d& accel_bias);

  /// Integrates the interval between two consecutive samples. Throws std::logic_error unless the
  /// stamps increase. `gap_s` is the length of the gap in the data when the samples are
  /// interpolated within one: the motion there is unknown, and the noise grows by that of an
  /// unknown constant rate and acceleration over the gap.
  void integrate(const ImuSample& from, const ImuSample& to, double gap_s = 0.0);

  double duration_s() const { return duration_s_; }
  /// At the biases given to the constructor.
  const Delta& delta() const { return delta_; }
  /// First-order correction for other biases (Forster et al., Eq. 44).
  Delta corrected(const Eigen::Vector3d& gyro_bias, const Eigen::Vector3d& accel_bias) const;
  /// Covariance of [rotation, velocity, position, gyro bias change, accel bias change].
  const Matrix& covariance() const { return covariance_; }
  /// d delta / d biases: rows rotation, velocity, position; columns gyro, accel.
  Eigen::Matrix<double, 9, 6> bias_jacobian() const { return jacobian_.topRightCorner<9, 6>(); }
  const Eigen::Vector3d& gyro_bias() const { return gyro_bias_; }
  const Eigen::Vector3d& accel_bias() const { return accel_bias_; }

 private:
  void step(const Eigen::Vector3d& gyro, const Eigen::Vector3d& accel, double dt, double gap_s);

  Noise noise_;
  Eigen::Vector3d gyro_bias_;
  Eigen::Vector3d accel_bias_;
  Delta delta_;
  double duration_s_ = 0.0;
  Matrix covariance_ = Matrix::Zero();
  Matrix jacobian_ = Matrix::Identity();  // d error state now / d error state at the start
};

}  // namespace apvi::imu
