// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <optional>
#include <vector>

#include "apvi/depth/options.hpp"
#include "depth/quadtree.hpp"
#include "gaussians/render/view.hpp"
#include "medium/medium.hpp"

namespace apvi::depth {

/// An image and its camera; `camera.pose_delta` is ignored.
struct DepthView {
  /// [H,W] float32 in [0, 1], undistorted (see `to_gray`), all on the device that runs the
  /// estimation.
  torch::Tensor gray;
  gaussians::View camera;
};

struct DepthRequest {
  /// The reference view first, then its neighbors; at most `options.views` are used.
  std::vector<DepthView> views;
  /// For PhotometricCost::absolute; without it, intensities are compared directly.
  std::optional<medium::Medium> medium;
};

/// Outcome of an estimation.
enum class DepthStatus {
  estimated,      ///< see each block's confidence
  too_few_views,  ///< no neighbor view
  no_baseline,    ///< all images from one position
  no_contrast,    ///< black or uniform image
};

/// All tensors on the CPU. B blocks, in the order of `blocks`.
struct DepthEstimate {
  DepthStatus status = DepthStatus::estimated;
  std::vector<Block> blocks;
  torch::Tensor points;      ///< [B,2] float32 block representative (x, y) [px]
  torch::Tensor depth;       ///< [B] float32 along the optical axis [m]; 0 where unknown
  torch::Tensor slope;       ///< [B,2] float32 relative change of 1/depth along x, y [1/px]
  torch::Tensor sigma;       ///< [B] float32 standard deviation of `depth` from parallax [m]
  torch::Tensor confidence;  ///< [B] float32 in [0, 1]
  torch::Tensor
      confident;        ///< [B] bool: confidence is at least `options.confidence.min_confidence`
  torch::Tensor dense;  ///< [H,W] float32 depth of every pixel [m]; 0 where unknown
  double near_m = 0.0;  ///< depth range of the search
  double far_m = 0.0;
  int views = 0;  ///< images compared with the reference
};

/// Depth of a keyframe from its neighbors (the paper's "lightweight quadtree-guided
/// densification"): a plane sweep of quadtree blocks against the other images, belief propagation
/// between neighboring blocks, refinement between hypotheses, and edge-aware upsampling of the
/// confident depths. Bit-identical on a CPU for any number of threads. Throws c10::Error naming the
/// view if an image or camera is invalid (shape, type, NaN).
DepthEstimate estimate_depth(const DepthRequest& request, const DepthOptions& options);

/// Luminance (Rec. 601) [H,W] float32 in [0, 1] of an image [H,W,3], uint8 or float, on the same
/// device.
torch::Tensor to_gray(const torch::Tensor& image);

}  // namespace apvi::depth
