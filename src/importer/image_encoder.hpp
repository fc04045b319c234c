// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "importer/assumed_camera.hpp"

namespace apvi::importer {

/// How images are stored.
struct ImageOptions {
  double scale = 1.0;  ///< of width and height, at most 1
  bool png = false;    ///< else JPEG
  int jpeg_quality = 95;

  std::string extension() const { return png ? ".png" : ".jpg"; }
};

/// The size of an image after scaling, at least one pixel.
ImageSize scaled(ImageSize size, double scale);
/// Scales (by pixel area, which does not alias) and encodes an image. Throws RunError when OpenCV
/// cannot.
std::vector<std::uint8_t> encode(const cv::Mat& image, const ImageOptions& options);
/// Scales intrinsics with the image, whose first pixel has its center at (0, 0).
CameraModel::Parameters scaled(CameraModel::Parameters camera, double scale);

}  // namespace apvi::importer
