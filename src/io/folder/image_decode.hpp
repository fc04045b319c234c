// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace apvi::io {

/// Reads an image file as 8-bit gray or BGR. Throws RunError when it cannot be decoded.
cv::Mat decode_image_file(const std::filesystem::path& path);

/// Image data of a message: an encoded file (compressed), or rows of `step` bytes.
struct RawImage {
  std::string name;  ///< for messages
  bool compressed = false;
  std::vector<std::uint8_t> bytes;
  std::size_t width = 0;
  std::size_t height = 0;
  std::size_t step = 0;
  bool big_endian = false;
  std::string encoding;  ///< ROS encoding: mono8, bgr8, bayer_rggb8, …
};

/// Whether the encoding is known and the data are large enough for the image size.
bool is_well_formed(const RawImage& raw);
/// The image as 8-bit gray or BGR. Throws RunError when it cannot be decoded.
cv::Mat decode_raw_image(const RawImage& raw);

}  // namespace apvi::io
