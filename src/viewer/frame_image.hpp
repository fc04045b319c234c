// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "viewer/scene.hpp"

namespace apvi::viewer {

/// An image of a layer for the screen.
struct LayerImage {
  cv::Mat bgr;          ///< 8 bit
  float near_m = 0.0F;  ///< of `depth`: depth of the ends of the color scale
  float far_m = 0.0F;
};

/// `seen` and `restored`: the color as rendered. `depth`: Turbo, from blue at the near end of the
/// scale, which is that of 2 to 98 % of the pixels, to red. `alpha`: gray. `normals`: of the
/// surface in the camera frame, (n + 1) / 2 as (red, green, blue) with y and z toward the top and
/// the camera. Empty pixels are black.
LayerImage layer_image(const Rendering& rendering, Layer layer, double focal_px);

/// JPEG of a quality from 1 to 100, or PNG. Throw RunError.
std::string jpeg(const cv::Mat& bgr, int quality);
std::string png(const cv::Mat& bgr);

}  // namespace apvi::viewer
