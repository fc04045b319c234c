// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/camera_model.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "apvi/core/error.hpp"

namespace apvi {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Coefficients = std::array<double, 4>;

// Brown-Conrady on the normalized plane, with d distorted / d undistorted.
Vector2d distort_radtan(const Vector2d& m, const Coefficients& k, Matrix2d& jacobian) {
  const double x = m.x();
  const double y = m.y();
  const double r2 = m.squaredNorm();
  const double radial = 1.0 + r2 * (k[0] + r2 * k[1]);
  const double slope = 2.0 * (k[0] + 2.0 * k[1] * r2);  // d radial / d r2, times two
  jacobian(0, 0) = radial + slope * x * x + 2.0 * k[2] * y + 6.0 * k[3] * x;
  jacobian(0, 1) = slope * x * y + 2.0 * k[2] * x + 2.0 * k[3] * y;
  jacobian(1, 0) = jacobian(0, 1);
  jacobian(1, 1) = radial + slope * y * y + 6.0 * k[2] * y + 2.0 * k[3] * x;
  return {radial * x + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x),
          radial * y + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y};
}

// Kannala-Brandt: distorted radius at an angle from the optical axis, and its derivative.
double equidistant_radius(double angle, const Coefficients& k, double& slope) {
  const double a2 = angle * angle;
  slope = 1.0 + a2 * (3.0 * k[0] + a2 * (5.0 * k[1] + a2 * (7.0 * k[2] + a2 * 9.0 * k[3])));
  return angle * (1.0 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3]))));
}

// First radius at which the radial profile stops increasing; beyond it, the model maps wide rays
// back into the image. Tangential terms are negligible here.
double fold_radius(const CameraModel::Parameters& p) {
  constexpr double kStep = 1e-3;
  const bool fisheye = p.distortion == Distortion::equidistant;
  const double end = fisheye ? std::numbers::pi : 10.0;
  if (p.distortion == Distortion::none) return std::numeric_limits<double>::infinity();
  for (double r = kStep; r < end; r += kStep) {
    double slope = 0.0;
    if (fisheye) {
      equidistant_radius(r, p.coefficients, slope);
    } else {
      slope = 1.0 + r * r * (3.0 * p.coefficients[0] + 5.0 * r * r * p.coefficients[1]);
    }
    if (slope <= 0.0) return r - kStep;
  }
  return fisheye ? end : std::numeric_limits<double>::infinity();
}

}  // namespace

CameraModel::CameraModel(const Parameters& parameters)
    : p_(parameters), max_radius_(fold_radius(parameters)) {
  APVI_CHECK(p_.fx > 0.0 && p_.fy > 0.0);
}

std::optional<Vector2d> CameraModel::project(const Vector3d& p, Jacobian23* jacobian) const {
  Vector2d distorted;
  Jacobian23 d_distorted;
  const double rho = p.head<2>().norm();
  if (p_.distortion == Distortion::equidistant && rho > 1e-9) {
    const double angle = std::atan2(rho, p.z());
    if (angle > max_radius_) return std::nullopt;
    double slope = 0.0;
    const double radius = equidistant_radius(angle, p_.coefficients, slope);
    const Vector2d direction = p.head<2>() / rho;
    distorted = radius * direction;
    const double n2 = p.squaredNorm();
    const Eigen::RowVector3d d_angle(direction.x() * p.z() / n2, direction.y() * p.z() / n2,
                                     -rho / n2);
    const Matrix2d across = (Matrix2d::Identity() - direction * direction.transpose()) / rho;
    d_distorted = slope * direction * d_angle;
    d_distorted.leftCols<2>() += radius * across;
  } else {
    if (p.z() <= 1e-9) return std::nullopt;
    const Vector2d m = p.head<2>() / p.z();
    if (p_.distortion == Distortion::radtan && m.norm() > max_radius_) return std::nullopt;
    Matrix2d d_m = Matrix2d::Identity();
    distorted = p_.distortion == Distortion::radtan ? distort_radtan(m, p_.coefficients, d_m) : m;
    Jacobian23 d_plane;
    d_plane << 1.0, 0.0, -m.x(), 0.0, 1.0, -m.y();
    d_distorted = d_m * d_plane / p.z();
  }
  const Vector2d focal(p_.fx, p_.fy);
  if (jacobian != nullptr) *jacobian = focal.asDiagonal() * d_distorted;
  return Vector2d(focal.cwiseProduct(distorted) + Vector2d(p_.cx, p_.cy));
}

std::optional<Vector3d> CameraModel::unproject(const Vector2d& pixel) const {
  const Vector2d target((pixel.x() - p_.cx) / p_.fx, (pixel.y() - p_.cy) / p_.fy);
  constexpr int kIterations = 30;
  constexpr double kTolerance = 1e-12;
  if (p_.distortion == Distortion::none) return Vector3d(target.x(), target.y(), 1.0).normalized();
  if (p_.distortion == Distortion::equidistant) {
    const double radius = target.norm();
    if (radius < 1e-12) return Vector3d::UnitZ();
    double angle = std::min(radius, max_radius_);
    for (int i = 0; i < kIterations; ++i) {
      double slope = 0.0;
      const double error = equidistant_radius(angle, p_.coefficients, slope) - radius;
      if (std::abs(error) < kTolerance) {
        const Vector2d direction = target / radius;
        return Vector3d(std::sin(angle) * direction.x(), std::sin(angle) * direction.y(),
                        std::cos(angle));
      }
      angle = std::clamp(angle - error / slope, 0.0, max_radius_);
    }
    return std::nullopt;
  }
  Vector2d m = target;
  for (int i = 0; i < kIterations; ++i) {
    Matrix2d jacobian;
    const Vector2d error = distort_radtan(m, p_.coefficients, jacobian) - target;
    if (error.norm() < kTolerance) {
      if (m.norm() > max_radius_) return std::nullopt;
      return Vector3d(m.x(), m.y(), 1.0).normalized();
    }
    m -= jacobian.inverse() * error;
  }
  return std::nullopt;
}

bool CameraModel::in_image(const Vector2d& pixel, double border_px) const {
  return pixel.x() >= border_px && pixel.y() >= border_px &&
         pixel.x() <= p_.width - 1 - border_px && pixel.y() <= p_.height - 1 - border_px;
}

}  // namespace apvi
