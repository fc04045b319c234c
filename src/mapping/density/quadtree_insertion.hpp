// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "apvi/mapping/options.hpp"
#include "depth/depth.hpp"
#include "mapping/density/seeds.hpp"
#include "mapping/rendering.hpp"

namespace apvi::mapping {

/// Depth [B] float32 of the Gaussian that a block gets [m]; 0: none.
torch::Tensor insertion_depths(const depth::DepthEstimate& estimate, InsertionDepth source);

/// Blocks of a depth estimate that need a Gaussian [B] bool: with an insertion depth in `depths`,
/// without any of `points` [n,2] float64 [px], and not yet covered by the map. `rendered` [H,W,3]
/// and `alpha` [H,W] are the map's rendering, `image` [H,W,3] is the observed image; all three
/// float32 on one device.
torch::Tensor blocks_to_fill(const depth::DepthEstimate& estimate, const torch::Tensor& depths,
                             const torch::Tensor& points, const torch::Tensor& rendered,
                             const torch::Tensor& alpha, const torch::Tensor& image,
                             const OnlineOptions& options);

/// One seed at the representative of each selected block, at its insertion depth in `depths`, of
/// the block's size.
Seeds seeds_from_blocks(const depth::DepthEstimate& estimate, const torch::Tensor& depths,
                        const torch::Tensor& which, double opacity);

/// Blocks [B] bool, on the CPU, that show nothing but the scene [H,W] bool.
torch::Tensor blocks_in_scene(const torch::Tensor& scene, const std::vector<depth::Block>& blocks);

/// Gaussians [N] bool, by their `means` [N,3], in free space: projected into a block with confident
/// depth and nearer than `depth_ratio` times that depth.
torch::Tensor in_free_space(const depth::DepthEstimate& estimate, const gaussians::View& view,
                            const torch::Tensor& means, double depth_ratio);

/// Means of images [C,H,W] float32 over each quadtree block, [C,B] on the same device.
torch::Tensor block_means(const torch::Tensor& images, const std::vector<depth::Block>& blocks);

}  // namespace apvi::mapping
