// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "apvi/geometry/so3.hpp"
#include "vio/window/frame_state.hpp"

/// Eigen views of parameter blocks and Jacobian rows, shared by all factors.
namespace apvi::vio {

using Matrix23 = Eigen::Matrix<double, 2, 3>;
using ConstVector3 = Eigen::Map<const Eigen::Vector3d>;

/// Jacobian of a cost function by a pose (seven columns, the last zero).
template <int Rows>
using PoseJacobian = Eigen::Map<Eigen::Matrix<double, Rows, kPoseSize, Eigen::RowMajor>>;
template <int Rows>
using MotionJacobian = Eigen::Map<Eigen::Matrix<double, Rows, kMotionSize, Eigen::RowMajor>>;

/// A pose with a rotation matrix.
struct Rigid {
  Eigen::Matrix3d R;
  Eigen::Vector3d p;

  Rigid(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& position)
      : R(rotation), p(position) {}
  explicit Rigid(const double* pose)
      : R(Eigen::Map<const Eigen::Quaterniond>(pose + 3).toRotationMatrix()), p(pose) {}
};

/// View of velocity and biases.
struct MotionView {
  ConstVector3 velocity, gyro_bias, accel_bias;

  explicit MotionView(const double* motion)
      : velocity(motion), gyro_bias(motion + 3), accel_bias(motion + 6) {}
};

/// Linearization point: the first estimate if there is one.
inline const double* pose_point(const FirstEstimate* first, const double* now) {
  return first != nullptr && first->pose ? first->pose->data() : now;
}
inline const double* motion_point(const FirstEstimate* first, const double* now) {
  return first != nullptr && first->motion ? first->motion->data() : now;
}

/// Each row c of `m` becomes c [v]x.
inline Matrix23 times_hat(const Matrix23& m, const Eigen::Vector3d& v) {
  Matrix23 result;
  result.row(0) = m.row(0).cross(v);
  result.row(1) = m.row(1).cross(v);
  return result;
}

}  // namespace apvi::vio
