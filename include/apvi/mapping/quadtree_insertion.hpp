// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "apvi/mapping/depth.hpp"
#include "apvi/mapping/options.hpp"
#include "apvi/mapping/rendering.hpp"
#include "apvi/mapping/seeds.hpp"

namespace apvi::mapping {

/// Which blocks of a depth estimate need a Gaussian [B] bool: those whose depth is believed, in
/// which none of `points` [n,2] float64 [px] lies, and that the map does not draw right already.
/// `drawn` [H,W,3] is what the map shows, `alpha` [H,W] how dense it is there, `picture` [H,W,3]
/// what the camera saw; all float32, these three on one device.
torch::Tensor blocks_to_fill(const DepthEstimate& estimate, const torch::Tensor& points,
                             const torch::Tensor& drawn, const torch::Tensor& alpha,
                             const torch::Tensor& picture, const OnlineOptions& options);

/// A seed in the middle of each of those blocks, as wide as the block.
Seeds seeds_of_blocks(const DepthEstimate& estimate, const torch::Tensor& which, double opacity);

/// Which Gaussians [N] bool, by their `means` [N,3], stand where the view looks through to a depth
/// that is believed: those that are drawn in such a block and nearer than `nearer` of its depth.
torch::Tensor in_free_space(const DepthEstimate& estimate, const splat::View& view,
                            const torch::Tensor& means, double nearer);

/// Means of images [C,H,W] float32 over each block of their quadtree, [C,B] where the images lie.
torch::Tensor block_means(const torch::Tensor& images, const std::vector<Block>& blocks);

}  // namespace apvi::mapping
