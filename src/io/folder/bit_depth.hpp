// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <memory>
#include <opencv2/core/mat.hpp>

namespace apvi::io {

/// The number of bits that a camera uses of its 16-bit images: 10, 12, 14 or 16. It is detected
/// from the brightest pixel of all images so far, so the brightness of an image does not depend on
/// its content; it grows when a later image needs more bits. Thread-safe.
class BitDepth {
 public:
  /// The 16-bit image as 8-bit image, with the range of the recording.
  cv::Mat to_eight_bits(const cv::Mat& image);
  int bits() const { return bits_; }

 private:
  std::atomic<int> bits_ = 0;
};

using SharedBitDepth = std::shared_ptr<BitDepth>;

}  // namespace apvi::io
