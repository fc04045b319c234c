// SPDX-License-Identifier: BSD-3-Clause
#include "depth/quadtree.hpp"

#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <bit>
#include <limits>
#include <numeric>
#include <utility>

namespace apvi::depth {
namespace {

constexpr std::size_t kExpectedNeighbors = 6;  // per block; a capacity hint

bool is_power_of_two(int n) {
  return n > 0 && (n & (n - 1)) == 0;
}

/// Intensity statistics of a block.
struct IntensityRange {
  float min = std::numeric_limits<float>::infinity();
  float max = -std::numeric_limits<float>::infinity();
  double sum = 0.0;

  void add(float value) {
    min = std::min(min, value);
    max = std::max(max, value);
    sum += static_cast<double>(value);
  }

  void add(const IntensityRange& other) {
    min = std::min(min, other.min);
    max = std::max(max, other.max);
    sum += other.sum;
  }
};

class QuadtreeBuilder {
 public:
  QuadtreeBuilder(const torch::Tensor& gray, const QuadtreeOptions& options)
      : pixels_(gray.data_ptr<float>()),
        width_(static_cast<int>(gray.size(1))),
        height_(static_cast<int>(gray.size(0))),
        options_(options) {}

  /// Blocks of the roots that start in row `y`.
  std::vector<Block> build(int y) {
    const int max_blocks = (width_ + options_.min_block_px - 1) / options_.min_block_px *
                           (options_.max_block_px / options_.min_block_px);
    blocks_.reserve(static_cast<std::size_t>(max_blocks));
    const Block image = {.width = width_, .height = height_};
    for (int x = 0; x < width_; x += options_.max_block_px) {
      add(block_in(image, x, y, options_.max_block_px));
    }
    return std::move(blocks_);
  }

 private:
  /// A block that is cut off by its parent.
  static Block block_in(const Block& parent, int x, int y, int size) {
    return {.x = x,
            .y = y,
            .size = size,
            .width = std::min(size, parent.x + parent.width - x),
            .height = std::min(size, parent.y + parent.height - y)};
  }

  /// Appends a block or its children. Children are appended first and removed again if the parent
  /// is uniform, so that every pixel is read once.
  IntensityRange add(const Block& block) {
    if (block.width <= 0 || block.height <= 0) return {};
    if (block.size <= options_.min_block_px) {
      const IntensityRange spread = intensity_range(block);
      keep(block, spread);
      return spread;
    }
    const std::size_t before = blocks_.size();
    const int side = std::max(block.size / 2, options_.min_block_px);
    IntensityRange spread;
    for (const auto& [dx, dy] : {std::pair{0, 0}, {side, 0}, {0, side}, {side, side}}) {
      spread.add(add(block_in(block, block.x + dx, block.y + dy, side)));
    }
    if (is_uniform(block, spread)) {
      blocks_.resize(before);
      keep(block, spread);
    }
    return spread;
  }

  void keep(Block block, const IntensityRange& spread) {
    block.mean = static_cast<float>(spread.sum / (block.width * block.height));
    blocks_.push_back(block);
  }

  /// Whether all pixels are within the threshold of the mean.
  bool is_uniform(const Block& block, const IntensityRange& spread) const {
    const double mean = spread.sum / (block.width * block.height);
    return std::max(spread.max - mean, mean - spread.min) <= options_.split_threshold;
  }

  /// Four columns at a time, for vectorization.
  IntensityRange intensity_range(const Block& block) const {
    std::array<IntensityRange, 4> columns;
    for (int y = block.y; y < block.y + block.height; ++y) {
      const float* const row = pixels_ + static_cast<std::ptrdiff_t>(y) * width_ + block.x;
      int x = 0;
      for (; x + 4 <= block.width; x += 4) {
        for (std::size_t k = 0; k < 4; ++k) columns[k].add(row[x + static_cast<int>(k)]);
      }
      for (; x < block.width; ++x) columns[0].add(row[x]);
    }
    IntensityRange out;
    for (const IntensityRange& column : columns) out.add(column);
    return out;
  }

  const float* pixels_;
  int width_;
  int height_;
  QuadtreeOptions options_;
  std::vector<Block> blocks_;
};

/// Block index of each cell. No cell contains pixels of two blocks.
class BlockIndexGrid {
 public:
  BlockIndexGrid(const std::vector<Block>& blocks, int width, int height)
      : shift_(shift_of(blocks)), columns_(((width - 1) >> shift_) + 1) {
    const int rows = ((height - 1) >> shift_) + 1;
    block_index_.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows));
    const int side = 1 << shift_;
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      const Block& b = blocks[i];
      for (int y = b.y; y < b.y + b.height; y += side) {
        for (int x = b.x; x < b.x + b.width; x += side) {
          block_index_[index(x, y)] = static_cast<std::int32_t>(i);
        }
      }
    }
  }

  std::int32_t at(int x, int y) const { return block_index_[index(x, y)]; }

 private:
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y >> shift_) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(x >> shift_);
  }

  /// Logarithm of the largest power of two that divides all positions, at most the smallest side.
  static int shift_of(const std::vector<Block>& blocks) {
    auto divided = static_cast<unsigned>(blocks.front().size);
    for (const Block& b : blocks) {
      divided = std::min(divided, std::bit_floor(static_cast<unsigned>(b.size)));
    }
    for (const Block& b : blocks) divided |= static_cast<unsigned>(b.x | b.y);
    return std::countr_zero(divided);
  }

  int shift_;  ///< a shift is faster than a division by the side
  int columns_;
  std::vector<std::int32_t> block_index_;
};

/// Index of each edge in the opposite direction. Neighbors and blocks are in ascending order, so
/// each block takes the next edge of its neighbor.
std::vector<std::int32_t> reverse_edges(const BlockGraph& graph) {
  std::vector<std::int32_t> reverse(graph.neighbors.size());
  std::vector<std::int32_t> next(graph.offsets.begin(), graph.offsets.end() - 1);
  for (std::size_t e = 0; e < reverse.size(); ++e) {
    reverse[e] = next[static_cast<std::size_t>(graph.neighbors[e])]++;
  }
  return reverse;
}

}  // namespace

std::vector<Block> build_quadtree(const torch::Tensor& gray, const QuadtreeOptions& options) {
  TORCH_CHECK(gray.dim() == 2 && gray.scalar_type() == torch::kFloat32 && gray.is_contiguous() &&
                  gray.device().is_cpu(),
              "quadtree: the image must be [H,W] float32 on the CPU");
  TORCH_CHECK(is_power_of_two(options.max_block_px) && options.min_block_px > 0 &&
                  options.min_block_px <= options.max_block_px,
              "quadtree: expected block sizes up to a power of two, got ", options.min_block_px,
              " to ", options.max_block_px);
  const std::int64_t side = options.max_block_px;
  const std::int64_t count = (gray.size(0) + side - 1) / side;
  std::vector<std::vector<Block>> strips(static_cast<std::size_t>(count));
  at::parallel_for(0, count, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) {
      strips[static_cast<std::size_t>(i)] =
          QuadtreeBuilder(gray, options).build(static_cast<int>(i * side));
    }
  });
  std::vector<Block> blocks;
  blocks.reserve(std::accumulate(strips.begin(), strips.end(), std::size_t{0},
                                 [](std::size_t n, const auto& s) { return n + s.size(); }));
  for (const auto& strip : strips) blocks.insert(blocks.end(), strip.begin(), strip.end());
  return blocks;
}

BlockGraph neighbor_graph(const std::vector<Block>& blocks, int width, int height) {
  BlockGraph graph;
  graph.offsets = {0};
  if (blocks.empty()) return graph;
  const BlockIndexGrid owners(blocks, width, height);
  graph.offsets.reserve(blocks.size() + 1);
  std::vector<std::int32_t>& all = graph.neighbors;
  all.reserve(kExpectedNeighbors * blocks.size());
  for (const Block& b : blocks) {  // step from neighbor to neighbor along each side
    const auto first = static_cast<std::ptrdiff_t>(all.size());
    for (const int x : {b.x - 1, b.x + b.width}) {
      for (int y = b.y; x >= 0 && x < width && y < b.y + b.height;) {
        all.push_back(owners.at(x, y));
        const Block& other = blocks[static_cast<std::size_t>(all.back())];
        y = other.y + other.height;
      }
    }
    for (const int y : {b.y - 1, b.y + b.height}) {
      for (int x = b.x; y >= 0 && y < height && x < b.x + b.width;) {
        all.push_back(owners.at(x, y));
        const Block& other = blocks[static_cast<std::size_t>(all.back())];
        x = other.x + other.width;
      }
    }
    std::sort(all.begin() + first, all.end());
    graph.offsets.push_back(static_cast<std::int32_t>(all.size()));
  }
  graph.reverse = reverse_edges(graph);
  return graph;
}

}  // namespace apvi::depth
