// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/geometry/so3.hpp"
#include "imu/preintegration.hpp"

namespace apvi::vio {

/// imu::Preintegration::corrected with the quantities needed for its derivative by the gyro bias.
struct CorrectedDelta {
  Eigen::Matrix3d R;                   ///< ΔR
  Eigen::Vector3d velocity, position;  ///< Δv, Δp
  Eigen::Matrix3d Jr;  ///< of the correction: dΔR = ΔR [Jr d(rotation)/d(bias) d(bias)]x

  CorrectedDelta(const imu::Preintegration& sum, const Eigen::Vector3d& gyro_bias,
                 const Eigen::Vector3d& accel_bias) {
    const Eigen::Matrix<double, 9, 6> by_bias = sum.bias_jacobian();
    const Eigen::Matrix<double, 9, 1> effect =
        by_bias.leftCols<3>() * (gyro_bias - sum.gyro_bias()) +
        by_bias.rightCols<3>() * (accel_bias - sum.accel_bias());
    const Eigen::Vector3d phi = effect.head<3>();
    R = (sum.delta().rotation * so3::exp(phi)).normalized().toRotationMatrix();
    velocity = sum.delta().velocity + effect.segment<3>(imu::Preintegration::kVelocity);
    position = sum.delta().position + effect.segment<3>(imu::Preintegration::kPosition);
    Jr = so3::right_jacobian(phi);
  }
};

}  // namespace apvi::vio
