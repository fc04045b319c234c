// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/geometry/so3.hpp"
#include "vio/factors/factors.hpp"

namespace apvi::vio {

using Eigen::Quaterniond;
using Eigen::Vector3d;

bool PoseManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const Eigen::Map<const Quaterniond> q(x + 3);
  const Eigen::Map<const Vector3d> theta(delta);
  const Vector3d p = Eigen::Map<const Vector3d>(x) + Eigen::Map<const Vector3d>(delta + 3);
  Eigen::Map<Quaterniond>(x_plus_delta + 3) = (q * so3::exp(theta)).normalized();
  Eigen::Map<Vector3d>{x_plus_delta} = p;
  return true;
}

bool PoseManifold::PlusJacobian(const double*, double* jacobian) const {
  using Jacobian = Eigen::Matrix<double, kPoseSize, kPoseTangent, Eigen::RowMajor>;
  Eigen::Map<Jacobian>(jacobian).setIdentity();
  return true;
}

bool PoseManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Eigen::Map<const Quaterniond> qy(y + 3);
  const Eigen::Map<const Quaterniond> qx(x + 3);
  const Vector3d dp = Eigen::Map<const Vector3d>(y) - Eigen::Map<const Vector3d>(x);
  Eigen::Map<Vector3d>{y_minus_x} = so3::log(qx.conjugate() * qy);
  Eigen::Map<Vector3d>(y_minus_x + 3) = dp;
  return true;
}

bool PoseManifold::MinusJacobian(const double*, double* jacobian) const {
  using Jacobian = Eigen::Matrix<double, kPoseTangent, kPoseSize, Eigen::RowMajor>;
  Eigen::Map<Jacobian>(jacobian).setIdentity();
  return true;
}

}  // namespace apvi::vio
