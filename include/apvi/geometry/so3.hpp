// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

/// Rotations in three dimensions. Tangent vectors are rotation vectors [rad]; perturbations act
/// from the right (body side): R ⊞ φ = R Exp(φ). Formulas: Sola, Deray, Atchuthan, "A micro Lie
/// theory for state estimation in robotics", 2018, section V and appendix B.
namespace apvi::so3 {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Skew-symmetric matrix [v]x with [v]x w = v x w.
Matrix3d hat(const Vector3d& v);
/// Exponential map as a unit quaternion; accurate to rounding at and near zero.
Quaterniond exp(const Vector3d& phi);
/// Inverse of `exp`; the result has norm at most pi.
Vector3d log(const Quaterniond& q);
/// Jr(φ) with Exp(φ + δ) ≈ Exp(φ) Exp(Jr δ).
Matrix3d right_jacobian(const Vector3d& phi);
/// Jr(φ)^-1; defined for |φ| < 2 pi.
Matrix3d right_jacobian_inverse(const Vector3d& phi);
/// The rotation nearest to `m` in the Frobenius norm (SVD); nullopt when `m` is a reflection,
/// singular, or farther than `tolerance` from orthonormal (norm of m - nearest).
std::optional<Matrix3d> nearest_rotation(const Matrix3d& m, double tolerance = 0.02);
/// The rotation angle between two orientations [rad], in [0, pi].
double angle_between(const Quaterniond& a, const Quaterniond& b);
/// Yaw of `q` (ZYX Euler angles) [rad], in (-pi, pi].
double yaw(const Quaterniond& q);
/// Roll and pitch, with zero yaw, of a body at rest that measures the specific force `force_body`
/// where gravity is `gravity_world`.
Quaterniond level_attitude(const Vector3d& force_body, const Vector3d& gravity_world);

}  // namespace apvi::so3
