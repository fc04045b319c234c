// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <opencv2/core/types.hpp>
#include <optional>

#include "apvi/sensors/camera_model.hpp"

/// Conversions between OpenCV pixels and the plane z = 1.
namespace apvi::vio {

inline cv::Point2f to_cv(const Eigen::Vector2d& p) {
  return {static_cast<float>(p.x()), static_cast<float>(p.y())};
}

/// Focal length: pixels per unit on the plane z = 1 near the optical axis.
inline double focal_length(const CameraModel& camera) {
  return 0.5 * (camera.parameters().fx + camera.parameters().fy);
}

/// x/z, y/z of the ray of a pixel; nullopt where the lens model has no inverse, and for rays more
/// than 84 degrees off the axis.
inline std::optional<Eigen::Vector2d> plane_point(const CameraModel& camera,
                                                  const cv::Point2f& pixel) {
  constexpr double kMinZ = 0.1;
  const auto ray = camera.unproject({pixel.x, pixel.y});
  if (!ray || ray->z() < kMinZ) return std::nullopt;
  return Eigen::Vector2d(ray->hnormalized());
}

}  // namespace apvi::vio
