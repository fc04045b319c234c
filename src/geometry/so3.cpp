// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/geometry/so3.hpp"

#include <Eigen/SVD>
#include <cmath>
#include <numbers>

namespace apvi::so3 {
namespace {

constexpr double kSmallAngle = 1e-4;  // below it, fourth-order series are accurate to rounding

// Coefficients of Jr = I - a [φ]x + b [φ]x².
double jacobian_a(double angle) {
  const double t2 = angle * angle;
  return angle < kSmallAngle ? 0.5 - t2 / 24.0 : (1.0 - std::cos(angle)) / t2;
}
double jacobian_b(double angle) {
  const double t2 = angle * angle;
  // angle - sin(angle) cancels numerically, so the series is used over a larger range.
  return angle < 1e-2 ? 1.0 / 6.0 - t2 / 120.0 + t2 * t2 / 5040.0
                      : (angle - std::sin(angle)) / (t2 * angle);
}
// Coefficient of Jr^-1 = I + [φ]x / 2 + c [φ]x².
double inverse_jacobian_c(double angle) {
  const double t2 = angle * angle;
  if (angle < 1e-2) return 1.0 / 12.0 + t2 / 720.0 + t2 * t2 / 30240.0;
  const double half = 0.5 * angle;
  return (1.0 - half * std::cos(half) / std::sin(half)) / t2;
}

}  // namespace

Matrix3d hat(const Vector3d& v) {
  Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

Quaterniond exp(const Vector3d& phi) {
  const double angle = phi.norm();
  const double half = 0.5 * angle;
  const double scale = angle < kSmallAngle ? 0.5 - angle * angle / 48.0 : std::sin(half) / angle;
  Quaterniond q(std::cos(half), scale * phi.x(), scale * phi.y(), scale * phi.z());
  return q.normalized();
}

Vector3d log(const Quaterniond& q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  const Vector3d v = sign * q.vec();
  const double w = sign * q.w();
  const double n = v.norm();
  if (n < kSmallAngle) return (2.0 / w) * (1.0 - n * n / (3.0 * w * w)) * v;
  return 2.0 * std::atan2(n, w) / n * v;
}

Matrix3d right_jacobian(const Vector3d& phi) {
  const double angle = phi.norm();
  const Matrix3d k = hat(phi);
  return Matrix3d::Identity() - jacobian_a(angle) * k + jacobian_b(angle) * k * k;
}

Matrix3d right_jacobian_inverse(const Vector3d& phi) {
  const Matrix3d k = hat(phi);
  return Matrix3d::Identity() + 0.5 * k + inverse_jacobian_c(phi.norm()) * k * k;
}

std::optional<Matrix3d> nearest_rotation(const Matrix3d& m, double tolerance) {
  if (!m.allFinite()) return std::nullopt;
  const Eigen::JacobiSVD<Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Matrix3d nearest = svd.matrixU() * svd.matrixV().transpose();
  if (nearest.determinant() < 0.0 || (m - nearest).norm() > tolerance) return std::nullopt;
  return nearest;
}

double angle_between(const Quaterniond& a, const Quaterniond& b) {
  return log(a.conjugate() * b).norm();
}

double yaw(const Quaterniond& q) {
  return std::atan2(2.0 * (q.w() * q.z() + q.x() * q.y()),
                    1.0 - 2.0 * (q.y() * q.y() + q.z() * q.z()));
}

Quaterniond level_attitude(const Vector3d& force_body, const Vector3d& gravity_world) {
  const Quaterniond tilt = Quaterniond::FromTwoVectors(force_body, -gravity_world);
  return (exp(Vector3d(0.0, 0.0, -yaw(tilt))) * tilt).normalized();
}

}  // namespace apvi::so3
