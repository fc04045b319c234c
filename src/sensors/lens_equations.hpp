// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "apvi/sensors/camera_model.hpp"

/// Lens equations of CameraModel, in units of the focal length.
namespace apvi::lens {

using Coefficients = CameraModel::Coefficients;

/// Radtan: the distorted point of a point on the plane z = 1, with d distorted / d point.
Eigen::Vector2d distort_radtan(const Eigen::Vector2d& m, const Coefficients& k,
                               Eigen::Matrix2d& jacobian);
/// Radtan without its tangential terms: distorted radius, and its derivative. The denominator of
/// the rational model must be positive, else the slope is not.
double radtan_radius(double radius, const Coefficients& k, double& slope);
/// Equidistant: distorted radius at an angle from the optical axis [rad], and its derivative.
double equidistant_radius(double angle, const Coefficients& k, double& slope);

/// Double sphere and EUCM project a point to (x, y) / denominator(x, y, z).
struct Denominator {
  double value = 0.0;
  Eigen::RowVector3d gradient = Eigen::RowVector3d::Zero();
};
/// nullopt outside of the model's domain. Double sphere: Usenko 2018, Eq. 40-45; EUCM: Khomutenko
/// 2016, Eq. 11, and Usenko 2018, Eq. 19-23.
std::optional<Denominator> sphere_denominator(const CameraModel::Parameters& camera,
                                              const Eigen::Vector3d& p);
/// The unit ray of a distorted point: Usenko 2018, Eq. 46-50 and 24-27. nullopt outside of the
/// model's image.
std::optional<Eigen::Vector3d> sphere_ray(const CameraModel::Parameters& camera,
                                          const Eigen::Vector2d& m);

}  // namespace apvi::lens
