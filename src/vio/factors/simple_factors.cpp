// SPDX-License-Identifier: BSD-3-Clause
#include "vio/factors/block_math.hpp"
#include "vio/factors/factors.hpp"

namespace apvi::vio {

using Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Vector9 = Eigen::Matrix<double, 9, 1>;

PressureDepthFactor::PressureDepthFactor(double depth_m, double sigma_m,
                                         const Vector3d& p_body_sensor, double sign,
                                         const FirstEstimate* first)
    : depth_m_(depth_m),
      sigma_m_(sigma_m),
      p_body_sensor_(p_body_sensor),
      sign_(sign),
      first_(first) {}

bool PressureDepthFactor::Evaluate(double const* const* parameters, double* residuals,
                                   double** jacobians) const {
  const Rigid now(parameters[0]);
  const double z = now.p.z() + now.R.row(2).dot(p_body_sensor_);
  residuals[0] = (sign_ * z + parameters[1][0] - depth_m_) / sigma_m_;
  if (jacobians == nullptr) return true;
  if (jacobians[1] != nullptr) jacobians[1][0] = 1.0 / sigma_m_;
  if (jacobians[0] == nullptr) return true;
  const Rigid at(pose_point(first_, parameters[0]));
  Eigen::Map<Eigen::Matrix<double, 1, 7>> J(jacobians[0]);
  J.setZero();
  J.head<3>() = sign_ / sigma_m_ * p_body_sensor_.transpose().cross(at.R.row(2));
  J(5) = sign_ / sigma_m_;
  return true;
}

PosePriorFactor::PosePriorFactor(const SE3& pose,
                                 const Eigen::Matrix<double, 6, 6>& sqrt_information)
    : pose_(pose), sqrt_information_(sqrt_information) {}

bool PosePriorFactor::Evaluate(double const* const* parameters, double* residuals,
                               double** jacobians) const {
  const Eigen::Map<const Eigen::Quaterniond> q(parameters[0] + 3);
  Vector6 error;
  error << so3::log(pose_.rotation.conjugate() * q),
      ConstVector3(parameters[0]) - pose_.translation;
  Eigen::Map<Vector6>{residuals} = sqrt_information_ * error;
  if (jacobians == nullptr || jacobians[0] == nullptr) return true;
  PoseJacobian<6> J(jacobians[0]);
  J.leftCols<3>() = sqrt_information_.leftCols<3>() * so3::right_jacobian_inverse(error.head<3>());
  J.middleCols<3>(3) = sqrt_information_.rightCols<3>();
  J.col(6).setZero();
  return true;
}

MotionPriorFactor::MotionPriorFactor(const MotionBlock& motion,
                                     const Eigen::Matrix<double, 9, 9>& sqrt_information)
    : motion_(motion), sqrt_information_(sqrt_information) {}

bool MotionPriorFactor::Evaluate(double const* const* parameters, double* residuals,
                                 double** jacobians) const {
  const Eigen::Map<const Vector9> now(parameters[0]);
  const Eigen::Map<const Vector9> expected(motion_.data());
  Eigen::Map<Vector9>{residuals} = sqrt_information_ * (now - expected);
  if (jacobians == nullptr || jacobians[0] == nullptr) return true;
  MotionJacobian<9>{jacobians[0]} = sqrt_information_;
  return true;
}

}  // namespace apvi::vio
