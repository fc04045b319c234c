// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "apvi/depth/options.hpp"

namespace apvi::depth {

/// A block of similar pixels; square unless cut off by its parent or the image border.
struct Block {
  int x = 0;  ///< column and row of the top-left pixel
  int y = 0;
  int size = 0;  ///< nominal side
  int width = 0;
  int height = 0;
  float mean = 0.0F;  ///< intensity
};

/// Divides an image [H,W] (float32, on the CPU) into a quadtree of blocks that cover every pixel
/// once (Wang et al., "Quadtree-accelerated real-time monocular dense mapping", 2018). A block is
/// split into four while it is larger than the smallest and one of its pixels deviates from its
/// mean by more than the threshold. The first child has half the side, but not less than the
/// smallest block; the others fill what is left. Ordered by root block, row by row. Throws
/// c10::Error if the image or the sizes are invalid.
std::vector<Block> build_quadtree(const torch::Tensor& gray, const QuadtreeOptions& options);

/// Symmetric adjacency of blocks: block i has neighbors neighbors[offsets[i] ... offsets[i + 1]),
/// and `reverse` is the index of the same edge in the opposite direction.
struct BlockGraph {
  std::vector<std::int32_t> offsets;
  std::vector<std::int32_t> neighbors;
  std::vector<std::int32_t> reverse;
};

/// Neighbors in ascending order. `blocks` must cover an image of this size.
BlockGraph neighbor_graph(const std::vector<Block>& blocks, int width, int height);

}  // namespace apvi::depth
