// SPDX-License-Identifier: BSD-3-Clause
#include "importer/image_encoder.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "apvi/core/error.hpp"

namespace apvi::importer {

ImageSize scaled(ImageSize size, double scale) {
  const auto side = [&](int s) { return std::max(1, static_cast<int>(std::lround(s * scale))); };
  return {side(size.width), side(size.height)};
}

std::vector<std::uint8_t> encode(const cv::Mat& image, const ImageOptions& options) {
  std::vector<std::uint8_t> bytes;
  try {
    cv::Mat small = image;
    if (options.scale != 1.0) {
      const ImageSize size = scaled(ImageSize{image.cols, image.rows}, options.scale);
      cv::resize(image, small, {size.width, size.height}, 0.0, 0.0, cv::INTER_AREA);
    }
    const std::vector<int> quality = {cv::IMWRITE_JPEG_QUALITY, options.jpeg_quality};
    if (cv::imencode(options.extension(), small, bytes,
                     options.png ? std::vector<int>{} : quality)) {
      return bytes;
    }
  } catch (const cv::Exception& e) {
    fail_run("an image cannot be encoded: {}", e.err);
  }
  fail_run("an image cannot be encoded as {}", options.extension());
}

CameraModel::Parameters scaled(CameraModel::Parameters camera, double scale) {
  const ImageSize size = scaled(ImageSize{camera.width, camera.height}, scale);
  const double x = static_cast<double>(size.width) / camera.width;
  const double y = static_cast<double>(size.height) / camera.height;
  camera.fx *= x;
  camera.fy *= y;
  camera.cx = (camera.cx + 0.5) * x - 0.5;
  camera.cy = (camera.cy + 0.5) * y - 0.5;
  camera.width = size.width;
  camera.height = size.height;
  return camera;
}

}  // namespace apvi::importer
