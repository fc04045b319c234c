// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/camera_model.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "apvi/core/error.hpp"
#include "apvi/sensors/lens.hpp"
#include "sensors/lens_equations.hpp"

namespace apvi {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Jacobian23 = CameraModel::Jacobian23;

constexpr int kIterations = 30;
constexpr double kTolerance = 1e-12;

bool is_sphere(Distortion distortion) {
  return distortion == Distortion::double_sphere || distortion == Distortion::eucm;
}

// First radius at which the radial profile stops increasing; beyond it, the model maps wide rays
// back into the image. Tangential terms are negligible here.
double fold_radius(const CameraModel::Parameters& p) {
  constexpr double kStep = 1e-3;
  const bool fisheye = p.distortion == Distortion::equidistant;
  const double end = fisheye ? std::numbers::pi : 10.0;
  if (!fisheye && p.distortion != Distortion::radtan)
    return std::numeric_limits<double>::infinity();
  for (double r = kStep; r < end; r += kStep) {
    double slope = 0.0;
    if (fisheye) {
      lens::equidistant_radius(r, p.coefficients, slope);
    } else {
      lens::radtan_radius(r, p.coefficients, slope);
    }
    if (slope <= 0.0) return r - kStep;
  }
  return fisheye ? end : std::numeric_limits<double>::infinity();
}

// Projections in units of the focal length, with d result / d point.

std::optional<Vector2d> project_equidistant(const lens::Coefficients& k, double max_angle,
                                            const Vector3d& p, Jacobian23& jacobian) {
  const double rho = p.head<2>().norm();
  const double angle = std::atan2(rho, p.z());
  if (angle > max_angle) return std::nullopt;
  double slope = 0.0;
  const double radius = lens::equidistant_radius(angle, k, slope);
  const Vector2d direction = p.head<2>() / rho;
  const double n2 = p.squaredNorm();
  const Eigen::RowVector3d d_angle(direction.x() * p.z() / n2, direction.y() * p.z() / n2,
                                   -rho / n2);
  const Matrix2d across = (Matrix2d::Identity() - direction * direction.transpose()) / rho;
  jacobian = slope * direction * d_angle;
  jacobian.leftCols<2>() += radius * across;
  return Vector2d(radius * direction);
}

std::optional<Vector2d> project_plane(const CameraModel::Parameters& camera, double max_radius,
                                      const Vector3d& p, Jacobian23& jacobian) {
  if (p.z() <= 1e-9) return std::nullopt;
  const bool radtan = camera.distortion == Distortion::radtan;
  const Vector2d m = p.head<2>() / p.z();
  if (radtan && m.norm() > max_radius) return std::nullopt;
  Matrix2d d_m = Matrix2d::Identity();
  const Vector2d distorted = radtan ? lens::distort_radtan(m, camera.coefficients, d_m) : m;
  Jacobian23 d_plane;
  d_plane << 1.0, 0.0, -m.x(), 0.0, 1.0, -m.y();
  jacobian = d_m * d_plane / p.z();
  return distorted;
}

std::optional<Vector2d> project_sphere(const CameraModel::Parameters& camera, const Vector3d& p,
                                       Jacobian23& jacobian) {
  const auto denominator = lens::sphere_denominator(camera, p);
  if (!denominator) return std::nullopt;
  const Vector2d m = p.head<2>() / denominator->value;
  jacobian = -m * denominator->gradient / denominator->value;
  jacobian.leftCols<2>() += Matrix2d::Identity() / denominator->value;
  return m;
}

// Inverses of the projections.

std::optional<Vector3d> equidistant_ray(const lens::Coefficients& k, double max_angle,
                                        const Vector2d& target) {
  const double radius = target.norm();
  if (radius < 1e-12) return Vector3d::UnitZ();
  double angle = std::min(radius, max_angle);
  for (int i = 0; i < kIterations; ++i) {
    double slope = 0.0;
    const double error = lens::equidistant_radius(angle, k, slope) - radius;
    if (std::abs(error) < kTolerance) {
      const Vector2d direction = target / radius;
      return Vector3d(std::sin(angle) * direction.x(), std::sin(angle) * direction.y(),
                      std::cos(angle));
    }
    angle = std::clamp(angle - error / slope, 0.0, max_angle);
  }
  return std::nullopt;
}

// Newton's method on the plane z = 1; nullopt where it does not converge within the lens.
std::optional<Vector2d> undistort_radtan(const lens::Coefficients& k, double max_radius,
                                         const Vector2d& target, Vector2d m) {
  for (int i = 0; i < kIterations; ++i) {
    Matrix2d jacobian;
    const Vector2d error = lens::distort_radtan(m, k, jacobian) - target;
    if (error.norm() < kTolerance * std::max(1.0, target.norm())) {
      if (m.norm() > max_radius) return std::nullopt;
      return m;
    }
    m -= jacobian.inverse() * error;
  }
  return std::nullopt;
}

// The undistorted radius without tangential terms, by bisection: strong distortion throws Newton's
// method out of the lens.
double undistorted_radius(const lens::Coefficients& k, double max_radius, double target) {
  constexpr double kFarthest = 20.0;  // 87 degrees
  constexpr int kHalvings = 40;
  double low = 0.0;
  double high = std::min(max_radius, kFarthest);
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    double slope = 0.0;
    (lens::radtan_radius(middle, k, slope) < target ? low : high) = middle;
  }
  return low;
}

std::optional<Vector3d> radtan_ray(const lens::Coefficients& k, double max_radius,
                                   const Vector2d& target) {
  auto m = undistort_radtan(k, max_radius, target, target);
  if (!m && target.allFinite()) {
    const double radius = undistorted_radius(k, max_radius, target.norm());
    m = undistort_radtan(k, max_radius, target, radius * target.normalized());
  }
  if (!m) return std::nullopt;
  return Vector3d(m->x(), m->y(), 1.0).normalized();
}

}  // namespace

CameraModel::CameraModel(const Parameters& parameters)
    : p_(parameters), max_radius_(fold_radius(parameters)) {
  APVI_CHECK(p_.fx > 0.0 && p_.fy > 0.0);
  APVI_CHECK(!lens_problem(p_));
}

std::optional<Vector2d> CameraModel::project(const Vector3d& p, Jacobian23* jacobian) const {
  Jacobian23 d_distorted;
  std::optional<Vector2d> distorted;
  if (is_sphere(p_.distortion)) {
    distorted = project_sphere(p_, p, d_distorted);
  } else if (p_.distortion == Distortion::equidistant && p.head<2>().norm() > 1e-9) {
    distorted = project_equidistant(p_.coefficients, max_radius_, p, d_distorted);
  } else {
    distorted = project_plane(p_, max_radius_, p, d_distorted);
  }
  if (!distorted) return std::nullopt;
  const Vector2d focal(p_.fx, p_.fy);
  if (jacobian != nullptr) *jacobian = focal.asDiagonal() * d_distorted;
  return Vector2d(focal.cwiseProduct(*distorted) + Vector2d(p_.cx, p_.cy));
}

std::optional<Vector3d> CameraModel::unproject(const Vector2d& pixel) const {
  const Vector2d target((pixel.x() - p_.cx) / p_.fx, (pixel.y() - p_.cy) / p_.fy);
  switch (p_.distortion) {
    case Distortion::none:
      return Vector3d(target.x(), target.y(), 1.0).normalized();
    case Distortion::radtan:
      return radtan_ray(p_.coefficients, max_radius_, target);
    case Distortion::equidistant:
      return equidistant_ray(p_.coefficients, max_radius_, target);
    case Distortion::double_sphere:
    case Distortion::eucm:
      return lens::sphere_ray(p_, target);
  }
  return std::nullopt;
}

bool CameraModel::in_image(const Vector2d& pixel, double border_px) const {
  return pixel.x() >= border_px && pixel.y() >= border_px &&
         pixel.x() <= p_.width - 1 - border_px && pixel.y() <= p_.height - 1 - border_px;
}

}  // namespace apvi
