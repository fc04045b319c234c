// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <optional>
#include <vector>

#include "apvi/mapping/depth_options.hpp"
#include "apvi/mapping/quadtree.hpp"
#include "apvi/splat/medium.hpp"
#include "apvi/splat/view.hpp"

namespace apvi::mapping {

/// A picture and the camera that took it; `camera.pose_delta` is not looked at.
struct DepthView {
  /// [H,W] float32 in [0, 1], without distortion (see `to_grey`); on the device that is to do the
  /// work, all on the same.
  torch::Tensor grey;
  splat::View camera;
};

struct DepthRequest {
  /// The first is the one whose depth is asked for; of the others the first `views` - 1 are used.
  std::vector<DepthView> views;
  /// The water, for PhotometricCost::absolute; without it the pictures are compared as they are.
  std::optional<splat::Medium> medium;
};

/// Why there is, or is no, depth.
enum class DepthVerdict {
  estimated,      ///< look at each block's confidence
  too_few_views,  ///< nothing to compare with
  no_baseline,    ///< all pictures were taken from one place
  no_contrast,    ///< a black or an even picture
};

/// All tensors on the CPU. B blocks, in the order of `blocks`.
struct DepthEstimate {
  DepthVerdict verdict = DepthVerdict::estimated;
  std::vector<Block> blocks;
  torch::Tensor points;      ///< [B,2] float32 representative of each: its centre (x, y) [px]
  torch::Tensor depth;       ///< [B] float32 along the optical axis [m]; 0 where nothing is known
  torch::Tensor slope;       ///< [B,2] float32 relative change of 1/depth to the right, down [1/px]
  torch::Tensor sigma;       ///< [B] float32 what the parallax allows: one sigma of `depth` [m]
  torch::Tensor confidence;  ///< [B] float32 in [0, 1]
  torch::Tensor confident;   ///< [B] bool: confidence is at least `options.confidence.least`
  torch::Tensor dense;       ///< [H,W] float32 depth of every pixel [m]; 0 where nothing is known
  double near_m = 0.0;       ///< between these the depths were looked for
  double far_m = 0.0;
  int views = 0;  ///< pictures compared with the reference
};

/// Depth of a keyframe out of its neighbours (the paper's "lightweight quadtree-guided
/// densification"): the blocks of a quadtree are compared with the other pictures at every
/// hypothesis, belief propagation makes neighbours agree, each winner is refined between its
/// hypotheses, and an edge-aware smoother spreads what is confident over the image. On a CPU the
/// same bits with any number of threads. Throws c10::Error when a picture or camera cannot be used
/// (shape, type, NaN), naming the view.
DepthEstimate estimate_depth(const DepthRequest& request, const DepthOptions& options);

/// Luminance (Rec. 601) [H,W] float32 in [0, 1] of a picture [H,W,3], uint8 or float, where that
/// lies.
torch::Tensor to_grey(const torch::Tensor& image);

}  // namespace apvi::mapping
