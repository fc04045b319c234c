// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace apvi {

/// Rigid transform. `T_a_b` maps coordinates from frame b to frame a: p_a = T_a_b * p_b, and
/// T_a_c = T_a_b * T_b_c.
struct SE3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< unit
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();         ///< [m]

  static SE3 identity() { return {}; }
  SE3 inverse() const {
    const Eigen::Quaterniond r = rotation.conjugate();
    return {r, -(r * translation)};
  }
  Eigen::Matrix4d matrix() const {
    Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
    m.topLeftCorner<3, 3>() = rotation.toRotationMatrix();
    m.topRightCorner<3, 1>() = translation;
    return m;
  }

  friend SE3 operator*(const SE3& a, const SE3& b) {
    return {(a.rotation * b.rotation).normalized(), a.rotation * b.translation + a.translation};
  }
  friend Eigen::Vector3d operator*(const SE3& a, const Eigen::Vector3d& p) {
    return a.rotation * p + a.translation;
  }
};

/// Spherical interpolation of the rotation, linear interpolation of the translation; `u` in [0, 1].
SE3 interpolate(const SE3& a, const SE3& b, double u);

}  // namespace apvi
