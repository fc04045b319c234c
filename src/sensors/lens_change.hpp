// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "apvi/sensors/camera_model.hpp"

/// A lens whose focal length and principal point are not those of the rig. The change has three
/// values: logarithm of the true over the rig's focal length, and the shift of the principal point
/// in focal lengths of the rig. Points are on the plane z = 1.
namespace apvi {

/// What distortion adds to the derivative of the rig's point by the change of the lens.
using DistortionByLens = Eigen::Matrix<double, 2, 3>;

/// At `point` and no change; zero without distortion, or where the lens does not see.
DistortionByLens distortion_by_lens(const CameraModel& camera, const Eigen::Vector2d& point);

/// The point at which the rig's lens sees what is truly at `point`. `distortion`: near that point,
/// without the noise of a measurement, which would shrink with the focal length and so change it.
/// The error is of second order in the change, and of first order in the distortion.
template <typename T>
Eigen::Matrix<T, 2, 1> rig_point(const Eigen::Matrix<T, 2, 1>& point,
                                 const DistortionByLens& distortion, const T* change) {
  using std::exp;
  const T ratio = exp(change[0]);
  const Eigen::Matrix<T, 3, 1> factors(ratio - T(1.0), change[1], change[2]);
  return ratio * point + factors.template tail<2>() + distortion.cast<T>() * factors;
}

/// The inverse of `rig_point`.
Eigen::Vector2d true_point(const Eigen::Vector2d& point, const DistortionByLens& distortion,
                           const double* change);

}  // namespace apvi
