// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "io/folder/bit_depth.hpp"

namespace apvi::io {

/// Reads an image file as 8-bit gray or BGR. 16-bit images are scaled by the `depth` of their
/// camera. Throws RunError when it cannot be decoded or is incomplete.
cv::Mat decode_image_file(const std::filesystem::path& path, BitDepth& depth);

/// Image data of a message: an encoded file (compressed), or rows of `step` bytes.
struct RawImage {
  std::string name;  ///< for messages
  bool compressed = false;
  std::vector<std::uint8_t> bytes;
  std::size_t width = 0;
  std::size_t height = 0;
  std::size_t step = 0;  ///< as recorded; ignored where the rows are known to be tightly packed
  bool big_endian = false;
  /// ROS encoding: mono8, bgr8, bayer_rggb8, …; the format of a compressed message, which may name
  /// that of its image before a semicolon.
  std::string encoding;
  SharedBitDepth depth = std::make_shared<BitDepth>();  ///< of the camera
};

/// Whether the data are large enough for the image size. True for an unsupported encoding, whose
/// size is unknown: decoding names it.
bool is_well_formed(const RawImage& raw);
/// The image as 8-bit gray or BGR. Throws RunError when it cannot be decoded.
cv::Mat decode_raw_image(const RawImage& raw);

}  // namespace apvi::io
