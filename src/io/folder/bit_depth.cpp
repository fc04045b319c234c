// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/bit_depth.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "apvi/core/log.hpp"

namespace apvi::io {
namespace {

int bits_of(const cv::Mat& image) {
  double brightest = 0.0;
  cv::minMaxLoc(image.reshape(1), nullptr, &brightest);
  for (const int bits : {10, 12, 14}) {
    if (brightest < std::ldexp(1.0, bits)) return bits;
  }
  return 16;
}

}  // namespace

cv::Mat BitDepth::to_eight_bits(const cv::Mat& image) {
  const int needed = bits_of(image);
  int known = bits_;
  while (needed > known && !bits_.compare_exchange_weak(known, needed)) {
  }
  if (known > 0 && needed > known) {
    log::info("camera: the images use {} bits, more than the {} bits seen before", needed, known);
  }
  cv::Mat result;
  image.convertTo(result, CV_8U, std::ldexp(1.0, 8 - std::max(needed, known)));
  return result;
}

}  // namespace apvi::io
