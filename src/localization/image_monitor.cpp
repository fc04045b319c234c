// SPDX-License-Identifier: BSD-3-Clause
#include "localization/image_monitor.hpp"

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"

namespace apvi::localization {

ImageMonitor::ImageMonitor(const std::vector<CameraCalibration>& cameras)
    : cameras_(cameras), counts_(cameras.size()) {}

// An image that cannot be decoded counts as lost; the run continues.
cv::Mat ImageMonitor::decode(const ImageFrame& image) {
  if (!image.decode) return {};
  const auto camera = static_cast<std::size_t>(image.camera);
  ImageCounts& counts = counts_.at(camera);
  ++counts.images;
  try {
    cv::Mat pixels = image.decode();
    check_size(pixels, camera);
    return pixels;
  } catch (const RunError& error) {
    if (counts.undecodable++ > 0) return {};
    counts.first_undecodable = error.what();
    log::warning("cam{}: {}; further such images are only counted", camera, error.what());
    return {};
  }
}

void ImageMonitor::check_size(const cv::Mat& image, std::size_t camera) {
  const CameraModel::Parameters& expected = cameras_.at(camera).model.parameters();
  if (image.cols == expected.width && image.rows == expected.height) return;
  ImageCounts& counts = counts_.at(camera);
  if (counts.wrong_size++ > 0) return;
  counts.first_wrong_size = fmt::format("an image has {} x {} px, the rig says {} x {} px",
                                        image.cols, image.rows, expected.width, expected.height);
  log::warning("cam{}: {}; further such images are only counted", camera, counts.first_wrong_size);
}

}  // namespace apvi::localization
