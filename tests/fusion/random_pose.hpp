// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>

#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"
#include "fusion/pose_estimate.hpp"

namespace apvi::test {

using apvi::kRadiansPerDegree;
using fusion::boxminus;
using fusion::boxplus;
using fusion::Matrix6;
using fusion::PoseEstimate;
using fusion::symmetric;
using fusion::Vector6;

inline Vector6 normal6(Random& random) {
  Vector6 v;
  for (int i = 0; i < 6; ++i) v(i) = random.normal();
  return v;
}

/// A random positive definite matrix with sigmas of about `rotation` [rad] and `position` [m].
inline Matrix6 random_covariance(Random& random, double rotation, double position) {
  Matrix6 A;
  for (int i = 0; i < 6; ++i) A.col(i) = normal6(random);
  A.topRows<3>() *= rotation;
  A.bottomRows<3>() *= position;
  Vector6 floor;
  floor << Eigen::Vector3d::Constant(rotation * rotation),
      Eigen::Vector3d::Constant(position * position);
  return 0.2 * A * A.transpose() + Matrix6(0.2 * floor.asDiagonal());
}

inline SE3 random_pose(Random& random) {
  const Vector6 v = normal6(random);
  return {so3::exp(v.head<3>()), 5.0 * v.tail<3>()};
}

/// A draw from N(0, covariance).
inline Vector6 draw(Random& random, const Matrix6& covariance) {
  return covariance.llt().matrixL() * normal6(random);
}

/// Diagonal covariance with sigmas `rotation_deg` [deg] and `position` [m].
inline Matrix6 diagonal(double rotation_deg, double position) {
  Vector6 sigma;
  sigma << Eigen::Vector3d::Constant(rotation_deg * kRadiansPerDegree),
      Eigen::Vector3d::Constant(position);
  return sigma.cwiseAbs2().asDiagonal();
}

}  // namespace apvi::test
