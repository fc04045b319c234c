// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/factors.hpp"

#include <Eigen/Core>
#include <cmath>

#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

using Matrix4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;

// Of the rotation by the heading of `from`, backwards.
Eigen::Matrix3d heading_rotation(double heading) {
  return Eigen::AngleAxisd(-heading, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

}  // namespace

NodeState to_state(const DriftCorrection& correction, const SE3& odometry) {
  const Eigen::Vector3d p = correction.transform() * odometry.translation;
  return {correction.heading, p.x(), p.y(), p.z()};
}

DriftCorrection to_correction(const NodeState& state, const SE3& odometry) {
  DriftCorrection correction{.heading = state[0]};
  correction.translation =
      Eigen::Vector3d(state[1], state[2], state[3]) - correction.transform() * odometry.translation;
  return correction;
}

EdgeFactor::EdgeFactor(const Edge& edge, const SE3& from, const SE3& to)
    : step_(from.rotation * edge.T_from_to.translation),
      turn_(so3::yaw(from.rotation * edge.T_from_to.rotation * to.rotation.conjugate())),
      weights_(1.0 / edge.sigmas.horizontal_m, 1.0 / edge.sigmas.horizontal_m,
               1.0 / edge.sigmas.vertical_m, 1.0 / edge.sigmas.heading_rad) {}

bool EdgeFactor::Evaluate(double const* const* states, double* residuals,
                          double** jacobians) const {
  const Eigen::Map<const Eigen::Vector4d> from(states[0]);
  const Eigen::Map<const Eigen::Vector4d> to(states[1]);
  const Eigen::Matrix3d R = heading_rotation(from[0]);
  const Eigen::Vector3d moved = R * (to.tail<3>() - from.tail<3>());
  Eigen::Map<Eigen::Vector4d> r(residuals);
  r << moved - step_, to[0] - from[0] - turn_;
  r = weights_.cwiseProduct(r);
  if (jacobians == nullptr) return true;
  Matrix4 J = Matrix4::Zero();
  J.topRightCorner<3, 3>() = R;
  J(3, 0) = 1.0;
  if (jacobians[1] != nullptr) {
    Eigen::Map<Matrix4>{jacobians[1]} = weights_.asDiagonal() * J;
  }
  J = -J;
  J.topLeftCorner<3, 1>() = -Eigen::Vector3d::UnitZ().cross(moved);
  if (jacobians[0] != nullptr) {
    Eigen::Map<Matrix4>{jacobians[0]} = weights_.asDiagonal() * J;
  }
  return true;
}

HeightFactor::HeightFactor(const Height& height, const SE3& odometry)
    : z_(odometry.translation.z()), weight_(1.0 / height.sigma_m) {}

bool HeightFactor::Evaluate(double const* const* states, double* residuals,
                            double** jacobians) const {
  residuals[0] = weight_ * (states[0][3] - z_);
  if (jacobians == nullptr || jacobians[0] == nullptr) return true;
  Eigen::Map<Eigen::Vector4d>{jacobians[0]} << 0.0, 0.0, 0.0, weight_;
  return true;
}

}  // namespace apvi::loop_closure
