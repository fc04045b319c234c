// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "apvi/depth/options.hpp"
#include "depth/depth.hpp"

namespace apvi::depth {

/// A surface that is known to a few pixels of disparity, and images that show it.
struct RefinementRequest {
  std::vector<DepthView> views;  ///< the reference first; all of the others are used
  /// [h,w] float32 depth of the reference along the optical axis [m], 0 where unknown, on the
  /// device of the images. A pixel stands for the middle of its part of the reference image.
  torch::Tensor depth;
};

/// On the device of the images.
struct RefinedDepth {
  /// [h,w] float32: the true depth divided by the given one; 1 where unknown.
  torch::Tensor ratio;
  /// [h,w] float32 in [0, 1]: how well the images near a pixel tell it; 0 where the given depth is
  /// unknown.
  torch::Tensor confidence;
};

/// Moves each pixel along its ray to where the images agree best: a plane sweep of a few pixels of
/// disparity around the given depth, with patches that are tilted like the surface, first at half
/// of the resolution, then finer, with parabolic interpolation. Within surfaces, the given depth is
/// smoothed before, so that its noise does not return with the ratio, and the changes after each
/// sweep, weighted by their confidence. Of `options`, the range and the number of hypotheses and
/// everything about blocks are not used. Throws c10::Error for invalid images or cameras.
RefinedDepth refine_depth(const RefinementRequest& request, const DepthOptions& options);

}  // namespace apvi::depth
