// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace apvi::vio {

/// Side of the square patch that optical flow compares [px].
inline constexpr int kFlowWindow = 21;
/// Coarsest pyramid level, each half as large as the one below: about 80 pixels wide, so that flow
/// reaches as far in a large image as in a small one.
int flow_levels(cv::Size image);

/// An image prepared for optical flow. Its buffers are reused.
struct FrameImage {
  cv::Mat gray;                  ///< 8 bit, original contrast
  cv::Mat equalized;             ///< contrast-equalized, or `gray` itself
  std::vector<cv::Mat> pyramid;  ///< of `equalized`: images and their derivatives
  double brightness = 0.0;       ///< mean of `gray` where it shows the scene
  double contrast = 0.0;         ///< standard deviation of the same

  /// Gradient of `equalized` at half size (CV_16SC2, Scharr). The pyramid alternates images and
  /// gradients. Empty if the image is hardly larger than a patch.
  cv::Mat half_gradient() const { return pyramid.size() > 3 ? pyramid[3] : cv::Mat(); }
};

/// Converts an image (8 or 16 bits or floats in [0, 1]; gray, BGR or BGRA) to 8-bit gray. False for
/// other formats.
bool to_gray(const cv::Mat& image, cv::Mat& gray);

/// Prepares images: CLAHE with a clip limit of 3 on 8x8 tiles, as in VINS-Mono.
class FramePreparer {
 public:
  explicit FramePreparer(bool equalize);

  /// Fills `frame.gray`, brightness and contrast; false if the size or format is wrong. The image
  /// is reduced `by` a whole number to means over as many pixels each way. Brightness and contrast
  /// are those where `mask` of the reduced image is not zero; empty: everywhere.
  static bool load(const cv::Mat& image, cv::Size size, FrameImage& frame, int by = 1,
                   const cv::Mat& mask = {});
  /// Computes the rest from `frame.gray`.
  void build_pyramid(FrameImage& frame) const;

 private:
  cv::Ptr<cv::CLAHE> clahe_;  // null: no equalization
};

/// True if two gray images are bitwise equal.
bool identical(const cv::Mat& a, const cv::Mat& b);

}  // namespace apvi::vio
