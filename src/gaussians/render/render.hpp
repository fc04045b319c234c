// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <memory>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/render/view.hpp"

namespace apvi::gaussians {

struct RenderOptions {
  int sh_degree = kMaxShDegree;  ///< maximum degree to evaluate
  double near_m = 0.01;          ///< near plane: Gaussians with a nearer center are culled [m]
  /// Variance added to every projected Gaussian [px²]; with `antialiased`, opacity is reduced to
  /// compensate (Yu et al., "Mip-Splatting", 2024).
  double low_pass_px2 = 0.3;
  bool antialiased = false;
  torch::Tensor background;  ///< [3] background color; undefined: black
  /// [N,3] per-Gaussian color factor, not differentiated; undefined: one.
  torch::Tensor light = {};
  /// Return the gradient with respect to the Gaussians in `RenderOutput::sparse_gradient` instead
  /// of through autograd, where the backend supports it: less memory, for a fused optimizer.
  bool sparse_gradient = false;
};

/// Per-Gaussian statistics for densification and pruning. Undefined without autograd
/// (torch::NoGradGuard): then only the images are rendered, which is faster.
struct RenderStatistics {
  torch::Tensor visible;     ///< [N] bool: touched at least one pixel's tile
  torch::Tensor radii_px;    ///< [N] larger half axis of the footprint at the cutoff [px]
  torch::Tensor max_weight;  ///< [N] largest blend weight over the pixels
  /// [N] norm of the loss gradient by the projected center, in units of half the image size (as in
  /// the reference implementation); written in place by the backward pass.
  torch::Tensor mean2d_gradient;
};

struct RenderOutput {
  torch::Tensor color;  ///< [H,W,3] alpha-weighted, over the background
  torch::Tensor depth;  ///< [H,W] expected depth along the optical axis [m]; 0 where alpha is 0
  torch::Tensor alpha;  ///< [H,W]
  RenderStatistics statistics;
  /// Filled by the backward pass; null when not requested or not supported by the backend.
  std::shared_ptr<const SparseGradient> sparse_gradient;
};

/// Renders the Gaussians from a view, without the medium. Differentiable with respect to every
/// tensor of `gaussians`, `view.pose_delta` and the background. Throws c10::Error for mismatched
/// shapes, types, devices or sizes.
RenderOutput render(const Gaussians& gaussians, const View& view, const RenderOptions& options);

/// Converts depth along the optical axis [H,W] to distance along the ray: depth times the length of
/// each pixel's ray at unit depth.
torch::Tensor depth_to_range(const torch::Tensor& depth, const Intrinsics& intrinsics);

}  // namespace apvi::gaussians
