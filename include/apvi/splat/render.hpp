// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <memory>

#include "apvi/splat/gaussians.hpp"
#include "apvi/splat/view.hpp"

namespace apvi::splat {

struct RenderOptions {
  int sh_degree = kMaxShDegree;  ///< at most so many degrees of what the map has
  double near_m = 0.01;          ///< Gaussians whose centre is nearer are not drawn [m]
  /// Variance added to every projected Gaussian [px²]; with `antialiased`, its opacity shrinks so
  /// that it covers as much as before (Yu et al., "Mip-Splatting", 2024).
  double low_pass_px2 = 0.3;
  bool antialiased = false;
  torch::Tensor background;  ///< [3] colour behind everything; undefined: black
  /// [N,3] by which each Gaussian's colour is multiplied, as given: no gradients; undefined: one.
  torch::Tensor light = {};
  /// Derivatives by the Gaussians go to `RenderOutput::rows` instead of to autograd where the
  /// backend can do so: for an optimiser that takes them from there, at a fraction of the memory.
  bool rows = false;
};

/// What densification and pruning want to know of each Gaussian. Undefined tensors where autograd
/// records nothing (torch::NoGradGuard): there only the images are made, in less time.
struct RenderStatistics {
  torch::Tensor visible;     ///< [N] bool: touched at least one pixel's tile
  torch::Tensor radii_px;    ///< [N] half of the larger axis of the footprint at the cut-off [px]
  torch::Tensor max_weight;  ///< [N] largest blend weight over the pixels
  /// [N] norm of the loss's gradient by the projected centre, in units of half the image's size (as
  /// the reference implementation counts); filled by the backward pass into this very tensor.
  torch::Tensor mean2d_gradient;
};

struct RenderOutput {
  torch::Tensor color;  ///< [H,W,3] alpha-weighted, over the background
  torch::Tensor depth;  ///< [H,W] expected depth along the optical axis [m]; 0 where alpha is 0
  torch::Tensor alpha;  ///< [H,W]
  RenderStatistics statistics;
  /// Filled by the backward pass; null when not asked for, or when autograd has the derivatives.
  std::shared_ptr<const GaussianRows> rows;
};

/// Draws the Gaussians as the view sees them, without water. Differentiable in every tensor of
/// `gaussians`, in `view.pose_delta` and in the background. Throws c10::Error for shapes, types,
/// devices or sizes that do not fit.
RenderOutput render(const Gaussians& gaussians, const View& view, const RenderOptions& options);

/// Distance along the ray from the depth along the optical axis: depth [H,W] times the length of
/// each pixel's ray at unit depth.
torch::Tensor depth_to_range(const torch::Tensor& depth, const Intrinsics& intrinsics);

}  // namespace apvi::splat
