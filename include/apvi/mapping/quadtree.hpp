// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "apvi/mapping/depth_options.hpp"

namespace apvi::mapping {

/// A rectangle of pixels that are alike; square but for what the image's edge cuts off.
struct Block {
  int x = 0;  ///< column and row of the top-left pixel
  int y = 0;
  int size = 0;  ///< side as divided: largest, ..., smallest
  int width = 0;
  int height = 0;
  float mean = 0.0F;  ///< of its intensities
};

/// Divides an image [H,W] (float32, on the CPU) into blocks that cover every pixel once (the
/// paper's quadtree; Wang et al., "Quadtree-accelerated real-time monocular dense mapping", 2018).
/// A block is divided into four while it is larger than the smallest and one of its pixels is
/// farther from its mean than the threshold. In the order of the largest blocks, row by row.
/// Throws c10::Error when the image is no such tensor or the sizes are not powers of two.
std::vector<Block> divide(const torch::Tensor& grey, const QuadtreeOptions& options);

/// Which blocks touch along an edge, both ways: block i has neighbours
/// neighbors[offsets[i] ... offsets[i + 1]), and the same edge seen from the other side is
/// `reverse`.
struct BlockGraph {
  std::vector<std::int32_t> offsets;
  std::vector<std::int32_t> neighbors;
  std::vector<std::int32_t> reverse;
};

/// Neighbours in ascending order. `blocks` must divide an image of this size.
BlockGraph neighbor_graph(const std::vector<Block>& blocks, int width, int height);

}  // namespace apvi::mapping
