// SPDX-License-Identifier: BSD-3-Clause
#include "sensors/lens_change.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace apvi {

// By the pixel that stays: 0 = d(pixel) / d(lens) - d(pixel) / d(point) * d(point) / d(lens).
DistortionByLens distortion_by_lens(const CameraModel& camera, const Eigen::Vector2d& point) {
  const CameraModel::Parameters& p = camera.parameters();
  CameraModel::Jacobian23 by_point;
  const auto pixel = camera.project(point.homogeneous(), &by_point);
  if (!pixel) return DistortionByLens::Zero();
  DistortionByLens by_lens;
  by_lens << *pixel - Eigen::Vector2d(p.cx, p.cy),
      Eigen::Vector2d(p.fx, p.fy).asDiagonal().toDenseMatrix();
  DistortionByLens undistorted;
  undistorted << point, Eigen::Matrix2d::Identity();
  return by_point.leftCols<2>().inverse() * by_lens - undistorted;
}

Eigen::Vector2d true_point(const Eigen::Vector2d& point, const DistortionByLens& distortion,
                           const double* change) {
  const Eigen::Vector3d factors(std::expm1(change[0]), change[1], change[2]);
  return std::exp(-change[0]) * (point - factors.tail<2>() - distortion * factors);
}

}  // namespace apvi
