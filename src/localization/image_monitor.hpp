// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "apvi/sensors/rig.hpp"
#include "apvi/sensors/samples.hpp"

namespace apvi::localization {

/// What became of the images of a camera. The first of each kind is described for messages.
struct ImageCounts {
  std::size_t images = 0;
  std::size_t undecodable = 0;  ///< damaged, incomplete, or of an unsupported encoding
  std::size_t wrong_size = 0;   ///< of another size than the camera's calibration
  std::string first_undecodable = {};
  std::string first_wrong_size = {};

  std::size_t unusable() const { return undecodable + wrong_size; }
};

/// Decodes images, counts the unusable ones and logs the first of each kind.
class ImageMonitor {
 public:
  explicit ImageMonitor(const std::vector<CameraCalibration>& cameras);

  /// The image; empty when it is lost or cannot be decoded. An image of the wrong size is returned.
  cv::Mat decode(const ImageFrame& image);

  /// By camera.
  const std::vector<ImageCounts>& counts() const { return counts_; }

 private:
  void check_size(const cv::Mat& image, std::size_t camera);

  std::vector<CameraCalibration> cameras_;
  std::vector<ImageCounts> counts_;
};

}  // namespace apvi::localization
