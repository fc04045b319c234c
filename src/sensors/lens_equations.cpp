// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/lens_equations.hpp"

#include <cmath>

namespace apvi::lens {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kMinDenominator = 1e-9;

// Radial factor of radtan at the squared radius, and its derivative.
struct Factor {
  double value = 1.0;
  double slope = 0.0;
  bool valid = true;
};

Factor radial_factor(double r2, const Coefficients& k) {
  const double above = 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
  const double below = 1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
  const double value = above / below;
  const double d_above = k[0] + r2 * (2.0 * k[1] + r2 * 3.0 * k[4]);
  const double d_below = k[5] + r2 * (2.0 * k[6] + r2 * 3.0 * k[7]);
  return {value, (d_above - value * d_below) / below, below > 0.0};
}

// The share of the rays behind that a sphere model with this alpha sees.
double seen_behind(double alpha) {
  return alpha > 0.5 ? (1.0 - alpha) / alpha : alpha / (1.0 - alpha);
}

std::optional<Denominator> double_sphere_denominator(double xi, double alpha, const Vector3d& p) {
  const double d1 = p.norm();
  const double w1 = seen_behind(alpha);
  const double w2 = (w1 + xi) / std::sqrt(2.0 * w1 * xi + xi * xi + 1.0);
  if (p.z() <= -w2 * d1) return std::nullopt;
  const double shifted = xi * d1 + p.z();
  const double d2 = std::hypot(p.x(), p.y(), shifted);
  const Eigen::RowVector3d d_d1 = p.transpose() / d1;
  const Eigen::RowVector3d d_shifted = xi * d_d1 + Eigen::RowVector3d::UnitZ();
  const Eigen::RowVector3d d_d2 =
      (Eigen::RowVector3d(p.x(), p.y(), 0.0) + shifted * d_shifted) / d2;
  return Denominator{alpha * d2 + (1.0 - alpha) * shifted,
                     alpha * d_d2 + (1.0 - alpha) * d_shifted};
}

std::optional<Denominator> eucm_denominator(double alpha, double beta, const Vector3d& p) {
  const double d = std::sqrt(beta * p.head<2>().squaredNorm() + p.z() * p.z());
  if (p.z() <= -seen_behind(alpha) * d) return std::nullopt;
  const Eigen::RowVector3d d_d = Eigen::RowVector3d(beta * p.x(), beta * p.y(), p.z()) / d;
  return Denominator{alpha * d + (1.0 - alpha) * p.z(),
                     alpha * d_d + (1.0 - alpha) * Eigen::RowVector3d::UnitZ()};
}

}  // namespace

Vector2d distort_radtan(const Vector2d& m, const Coefficients& k, Matrix2d& jacobian) {
  const double x = m.x();
  const double y = m.y();
  const double r2 = m.squaredNorm();
  const Factor radial = radial_factor(r2, k);
  const double slope = 2.0 * radial.slope;
  jacobian(0, 0) = radial.value + slope * x * x + 2.0 * k[2] * y + 6.0 * k[3] * x;
  jacobian(0, 1) = slope * x * y + 2.0 * k[2] * x + 2.0 * k[3] * y;
  jacobian(1, 0) = jacobian(0, 1);
  jacobian(1, 1) = radial.value + slope * y * y + 6.0 * k[2] * y + 2.0 * k[3] * x;
  return {radial.value * x + 2.0 * k[2] * x * y + k[3] * (r2 + 2.0 * x * x),
          radial.value * y + k[2] * (r2 + 2.0 * y * y) + 2.0 * k[3] * x * y};
}

double radtan_radius(double radius, const Coefficients& k, double& slope) {
  const double r2 = radius * radius;
  const Factor radial = radial_factor(r2, k);
  slope = radial.valid ? radial.value + 2.0 * r2 * radial.slope : -1.0;
  return radius * radial.value;
}

double equidistant_radius(double angle, const Coefficients& k, double& slope) {
  const double a2 = angle * angle;
  slope = 1.0 + a2 * (3.0 * k[0] + a2 * (5.0 * k[1] + a2 * (7.0 * k[2] + a2 * 9.0 * k[3])));
  return angle * (1.0 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3]))));
}

std::optional<Denominator> sphere_denominator(const CameraModel::Parameters& camera,
                                              const Vector3d& p) {
  const Coefficients& k = camera.coefficients;
  if (p.squaredNorm() < kMinDenominator * kMinDenominator) return std::nullopt;
  auto denominator = camera.distortion == Distortion::double_sphere
                         ? double_sphere_denominator(k[0], k[1], p)
                         : eucm_denominator(k[0], k[1], p);
  // Not so for NaN either.
  if (!denominator || !(denominator->value > kMinDenominator * p.norm())) return std::nullopt;
  return denominator;
}

std::optional<Vector3d> sphere_ray(const CameraModel::Parameters& camera, const Vector2d& m) {
  const bool eucm = camera.distortion == Distortion::eucm;
  const double alpha = camera.coefficients[eucm ? 0 : 1];
  const double beta = eucm ? camera.coefficients[1] : 1.0;
  const double xi = eucm ? 0.0 : camera.coefficients[0];
  const double r2 = m.squaredNorm();
  const double under_root = 1.0 - (2.0 * alpha - 1.0) * beta * r2;
  if (!(under_root >= 0.0)) return std::nullopt;
  const double z =
      (1.0 - beta * alpha * alpha * r2) / (alpha * std::sqrt(under_root) + 1.0 - alpha);
  if (eucm) return Vector3d(m.x(), m.y(), z).normalized();
  const double second = z * z + (1.0 - xi * xi) * r2;
  if (!(second >= 0.0)) return std::nullopt;
  const double scale = (z * xi + std::sqrt(second)) / (z * z + r2);
  return Vector3d(scale * m.x(), scale * m.y(), scale * z - xi).normalized();
}

}  // namespace apvi::lens
