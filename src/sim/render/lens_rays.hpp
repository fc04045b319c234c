// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "apvi/sensors/camera_model.hpp"
#include "apvi/sensors/rig.hpp"

namespace apvi::sim {

/// Rays of all pixels: unit vectors in the camera frame, zero where the distortion cannot be
/// inverted, and where they start in the camera frame [m] (empty: at the camera center).
struct Lens {
  int width = 0;
  int height = 0;
  std::vector<Eigen::Vector3f> rays;
  std::vector<Eigen::Vector3f> origins;
  std::vector<float> angle;  ///< between a pixel and its neighbor [rad]

  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(x);
  }
};

/// Throws InputError for an image that is too small to render.
Lens make_lens(const CameraModel& camera, const std::optional<PortCalibration>& port);

}  // namespace apvi::sim
