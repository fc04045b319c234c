// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <optional>

#include "apvi/io/sequence.hpp"

namespace apvi::doctor {

/// Finds what a moving camera always sees at the same pixels: parts of the vehicle, an overlay, the
/// rim of its port.
///
/// The direction of the image gradient is averaged over images. Where the scene moves by, it
/// cancels out; on edges of what is fixed to the camera it adds up, in any brightness. Regions that
/// such edges enclose, also with the image's border, and that change little are static too. So are
/// regions that hardly change and whose outline keeps its orientation, though it may be now
/// brighter and now darker than the scene beside it. Open water hardly changes either, but has no
/// outline.
class StaticParts {
 public:
  /// `size`: of the images.
  explicit StaticParts(cv::Size size);

  /// Adds a gray or BGR image. Images of another size or format are ignored, and those that show
  /// nothing or the same as the last one.
  void add(const cv::Mat& image);
  int images() const { return images_; }

  /// A mask as in CameraCalibration, 0 where the images are static, with a margin. All 255 until
  /// there are `kMinImages`.
  cv::Mat mask() const;
  /// Fraction of the image that the mask hides.
  double share() const;
  /// The mean of the images [height,width], 8-bit gray, in which static parts are sharp.
  cv::Mat mean_image() const;

  static constexpr int kMinImages = 20;
  static constexpr double kMaxShare = 0.6;  ///< more means that the vehicle hardly moves

 private:
  bool is_new(const cv::Mat& gray);
  cv::Mat static_edges() const;
  cv::Mat outlines() const;

  cv::Size size_;
  int by_ = 1;            // that images are reduced by
  cv::Mat directions_;    // CV_32FC2, sum of gradient directions
  cv::Mat orientations_;  // CV_32FC2, the same of twice their angle
  cv::Mat contrast_;      // CV_32F, sum of their squared lengths
  cv::Mat brightness_;    // CV_32F, sum
  cv::Mat brightness_2_;  // CV_32F, sum of squares
  cv::Mat last_;          // CV_32F, the last image, tiny
  int images_ = 0;
};

struct StaticSearch {
  int camera = 0;
  std::size_t images = 200;                ///< at most, evenly spread over the recording
  std::function<void(double)> progress{};  ///< fraction done
  std::function<bool()> interrupted{};     ///< stop and use what has been read
};

/// Reads images of a recording. Nothing if there are none of that camera. Throws InputError when
/// the recording cannot be opened.
std::optional<StaticParts> find_static_parts(const io::DatasetConfig& config,
                                             const StaticSearch& search);

}  // namespace apvi::doctor
