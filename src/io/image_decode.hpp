// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace apvi::io {

/// Reads an image file as 8-bit grey or BGR. Throws RunError when it is damaged or no image.
cv::Mat decode_image_file(const std::filesystem::path& path);

/// Pixels as a message carries them: a file in memory (compressed), or rows of `step` bytes.
struct RawImage {
  std::string name;  ///< for messages
  bool compressed = false;
  std::vector<std::uint8_t> bytes;
  std::size_t width = 0;
  std::size_t height = 0;
  std::size_t step = 0;
  bool big_endian = false;
  std::string encoding;  ///< in the words of ROS: mono8, bgr8, bayer_rggb8, …
};

/// Whether the bytes hold as many pixels as the image says, in an encoding that is known.
bool fits(const RawImage& raw);
/// The image as 8-bit grey or BGR. Throws RunError when it cannot be decoded.
cv::Mat decode_raw_image(const RawImage& raw);

}  // namespace apvi::io
