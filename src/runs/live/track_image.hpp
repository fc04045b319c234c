// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"

namespace apvi::runs {

/// A camera image with the landmarks that are observed in it.
struct TrackImage {
  cv::Mat image;  ///< 8-bit gray or BGR, as recorded
  CameraModel camera;
  SE3 T_world_camera;
  std::vector<Eigen::Vector3d> points;  ///< in the world [m]
};

/// The image with a ring at every landmark, at most 480 pixels wide, as a message for the page.
std::string camera_image(const TrackImage& track);

}  // namespace apvi::runs
