// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace torch::serialize {
class InputArchive;
class OutputArchive;
}  // namespace torch::serialize

namespace apvi::mapping {

/// Robust weights of pixels in the photometric loss: low where an image shows something that is not
/// in the map because it moves, such as a fish.
///
/// A block is a pixel of a small image, or several of one at least 640 pixels wide or high. Its
/// residual, averaged over its neighbors, is the mean absolute difference between image and
/// rendering plus a multiple of the difference of their colors regardless of brightness, which
/// caustics and shadows hardly change. A block is an outlier if its residual and
/// that of half of its neighbors exceed a multiple of the running median over all views, or of the
/// median of its own view if that is larger. So are blocks connected to it that exceed a lower
/// multiple. The trimmed residuals and their smoothing are those of RobustNeRF (Sabour et al., CVPR
/// 2023), the two running thresholds those of SpotLessSplats (Sabour et al., 2024).
///
/// A surface that is merely not fitted yet is protected: blocks that the map does not cover are no
/// outliers, nor are those of a view at its first use or of a view in which a large part does not
/// fit. Outliers are found anew at every third use, and keep a small weight. Where a view is the
/// only one that sees a surface, Adam makes full steps with small gradients too; where others see
/// it as well, theirs decide.
///
/// Nothing is read back from the device.
class RobustWeights {
 public:
  /// A rendering and the image that it should equal, in the camera's own values.
  struct Comparison {
    torch::Tensor rendered;  ///< [h,w,3]
    torch::Tensor alpha;     ///< [h,w]
    torch::Tensor image;     ///< [h,w,3]
  };

  explicit RobustWeights(std::size_t views) : uses_(views, 0), outliers_(views) {}

  void add_view();
  /// Weights [h,w] of the pixels of a view. Undefined: all one. Counts as a use.
  torch::Tensor weigh(std::size_t view, const Comparison& seen);
  /// The outliers, bool [h,w], of a view whose uses do not matter. None before the first use of
  /// any.
  torch::Tensor outliers(const Comparison& seen) const;
  /// The pixels, bool [height,width], whose weight was low at the latest use of a view with a full
  /// image of that size.
  torch::Tensor lowered(std::size_t view, std::int64_t height, std::int64_t width) const;

  void save(torch::serialize::OutputArchive& archive) const;
  /// Throws c10::Error when the archive does not match.
  void load(torch::serialize::InputArchive& archive);

 private:
  void search(std::size_t view, std::int64_t use, const Comparison& seen);

  std::vector<std::int64_t> uses_;
  std::vector<torch::Tensor> outliers_;  ///< by block, bool; or undefined
  torch::Tensor scale_;  ///< [] running median of the residual; undefined before the first use
};

}  // namespace apvi::mapping
