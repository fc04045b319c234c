// SPDX-License-Identifier: BSD-3-Clause
#include "io/image_decode.hpp"

#include <opencv2/imgcodecs.hpp>

#include "apvi/core/error.hpp"

namespace apvi::io {

cv::Mat decode_image_file(const std::filesystem::path& path) {
  cv::Mat image;
  try {
    image = cv::imread(path.string(), cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception& e) {
    fail_run("{}: cannot decode this image: {}", path.string(), e.err);
  }
  if (image.empty()) fail_run("{}: cannot decode this image; is the file damaged?", path.string());
  return image;
}

}  // namespace apvi::io
