// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace apvi::vio {

/// Side of the square patch that optical flow compares [px].
inline constexpr int kFlowWindow = 21;
/// Coarsest pyramid level, each half as large as the one below.
inline constexpr int kFlowLevels = 3;

/// An image made ready for optical flow. Its buffers are used again when it is filled again.
struct FrameImage {
  cv::Mat grey;                  ///< 8 bit, as recorded
  cv::Mat even;                  ///< contrast evened out, or `grey` itself
  std::vector<cv::Mat> pyramid;  ///< of `even`: images and their derivatives
  double brightness = 0.0;       ///< mean of `grey`
  double contrast = 0.0;         ///< standard deviation of `grey`

  /// Of `even` at half its size (CV_16SC2, Scharr). The pyramid holds image, gradient, image, …
  /// Empty when the image is hardly larger than a patch.
  cv::Mat half_gradient() const { return pyramid.size() > 3 ? pyramid[3] : cv::Mat(); }
};

/// 8-bit grey of an image of 8 or 16 bits or of floats in [0, 1], grey, BGR or BGRA. False for
/// anything else.
bool to_grey(const cv::Mat& image, cv::Mat& grey);

/// Makes images ready. CLAHE with a clip limit of 3 on 8x8 tiles, as VINS-Mono does.
class FramePreparer {
 public:
  explicit FramePreparer(bool equalize);

  /// Fills `frame.grey`, brightness and contrast; false when the image has another size or format.
  static bool take(const cv::Mat& image, cv::Size size, FrameImage& frame);
  /// Fills the rest from `frame.grey`.
  void build_pyramid(FrameImage& frame) const;

 private:
  cv::Ptr<cv::CLAHE> clahe_;  // null: leave the contrast as it is
};

/// Whether two grey images are the same to the last bit.
bool identical(const cv::Mat& a, const cv::Mat& b);

}  // namespace apvi::vio
