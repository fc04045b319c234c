// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <opencv2/core/types.hpp>
#include <optional>

#include "apvi/sensors/camera_model.hpp"

/// Between OpenCV's pixels and the plane z = 1.
namespace apvi::vio {

inline cv::Point2f to_cv(const Eigen::Vector2d& p) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y())};
}

/// Pixels of a length of one on the plane z = 1 about the optical axis.
inline double focal_length(const CameraModel& camera) {
  return 0.5 * (camera.parameters().fx + camera.parameters().fy);
}

/// x/z, y/z of what a pixel sees; nothing where the lens model has no inverse, and for rays more
/// than 84 degrees off the axis, which the plane cannot hold.
inline std::optional<Eigen::Vector2d> plane_point(const CameraModel& camera,
                                                  const cv::Point2f& pixel) {
  constexpr double kMinZ = 0.1;
  const auto ray = camera.unproject({pixel.x, pixel.y});
  if (!ray || ray->z() < kMinZ) return std::nullopt;
  return Eigen::Vector2d(ray->hnormalized());
}

}  // namespace apvi::vio
