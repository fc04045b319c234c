// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/quadtree.hpp"

#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <utility>

namespace apvi::mapping {
namespace {

constexpr std::size_t kUsualNeighbors = 6;  // of a block; it is no limit

bool is_power_of_two(int n) {
  return n > 0 && (n & (n - 1)) == 0;
}

/// Intensities of a block.
struct Spread {
  float least = std::numeric_limits<float>::infinity();
  float most = -std::numeric_limits<float>::infinity();
  double sum = 0.0;

  void add(float value) {
    least = std::min(least, value);
    most = std::max(most, value);
    sum += static_cast<double>(value);
  }

  void add(const Spread& other) {
    least = std::min(least, other.least);
    most = std::max(most, other.most);
    sum += other.sum;
  }
};

class Divider {
 public:
  Divider(const torch::Tensor& grey, const QuadtreeOptions& options)
      : pixels_(grey.data_ptr<float>()),
        width_(static_cast<int>(grey.size(1))),
        height_(static_cast<int>(grey.size(0))),
        options_(options) {}

  /// The largest blocks that begin in row `y`, or their parts.
  std::vector<Block> divide(int y) {
    const int most = (width_ + options_.smallest_px - 1) / options_.smallest_px *
                     (options_.largest_px / options_.smallest_px);
    blocks_.reserve(static_cast<std::size_t>(most));
    for (int x = 0; x < width_; x += options_.largest_px) add(x, y, options_.largest_px);
    return std::move(blocks_);
  }

 private:
  /// Puts a block or its parts behind the others. The parts come first and make room again where
  /// the whole is even, so that every pixel is looked at once.
  Spread add(int x, int y, int size) {
    if (x >= width_ || y >= height_) return {};
    const Block block = {.x = x,
                         .y = y,
                         .size = size,
                         .width = std::min(size, width_ - x),
                         .height = std::min(size, height_ - y)};
    if (size <= options_.smallest_px) {
      const Spread spread = spread_of(block);
      keep(block, spread);
      return spread;
    }
    const std::size_t before = blocks_.size();
    const int half = size / 2;
    Spread spread;
    for (const auto& [dx, dy] : {std::pair{0, 0}, {half, 0}, {0, half}, {half, half}}) {
      spread.add(add(x + dx, y + dy, half));
    }
    if (is_even(block, spread)) {
      blocks_.resize(before);
      keep(block, spread);
    }
    return spread;
  }

  void keep(Block block, const Spread& spread) {
    block.mean = static_cast<float>(spread.sum / (block.width * block.height));
    blocks_.push_back(block);
  }

  /// Whether all pixels are within the threshold of their mean.
  bool is_even(const Block& block, const Spread& spread) const {
    const double mean = spread.sum / (block.width * block.height);
    return std::max(spread.most - mean, mean - spread.least) <= options_.threshold;
  }

  /// Four columns side by side, which a processor does at once.
  Spread spread_of(const Block& block) const {
    std::array<Spread, 4> columns;
    for (int y = block.y; y < block.y + block.height; ++y) {
      const float* const row = pixels_ + static_cast<std::ptrdiff_t>(y) * width_ + block.x;
      int x = 0;
      for (; x + 4 <= block.width; x += 4) {
        for (std::size_t k = 0; k < 4; ++k) columns[k].add(row[x + static_cast<int>(k)]);
      }
      for (; x < block.width; ++x) columns[0].add(row[x]);
    }
    Spread out;
    for (const Spread& column : columns) out.add(column);
    return out;
  }

  const float* pixels_;
  int width_;
  int height_;
  QuadtreeOptions options_;
  std::vector<Block> blocks_;
};

/// Which block each square of the smallest block's side belongs to.
class Owners {
 public:
  Owners(const std::vector<Block>& blocks, int width, int height)
      : shift_(shift_of(blocks)), columns_(((width - 1) >> shift_) + 1) {
    const int rows = ((height - 1) >> shift_) + 1;
    owner_.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows));
    const int side = 1 << shift_;
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      const Block& b = blocks[i];
      for (int y = b.y; y < b.y + b.height; y += side) {
        for (int x = b.x; x < b.x + b.width; x += side) {
          owner_[index(x, y)] = static_cast<std::int32_t>(i);
        }
      }
    }
  }

  std::int32_t at(int x, int y) const { return owner_[index(x, y)]; }

 private:
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y >> shift_) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(x >> shift_);
  }

  /// Sides are powers of two: of the smallest, which.
  static int shift_of(const std::vector<Block>& blocks) {
    const auto smallest =
        std::min_element(blocks.begin(), blocks.end(),
                         [](const Block& a, const Block& b) { return a.size < b.size; });
    int shift = 0;
    while (1 << shift < smallest->size) ++shift;
    return shift;
  }

  int shift_;  ///< shifting by it takes less time than dividing by the side
  int columns_;
  std::vector<std::int32_t> owner_;
};

/// The same edge seen from its other end. Neighbours are in ascending order, and so are the blocks
/// that come by here: each meets the next edge of its neighbour's.
std::vector<std::int32_t> reverse_edges(const BlockGraph& graph) {
  std::vector<std::int32_t> reverse(graph.neighbors.size());
  std::vector<std::int32_t> next(graph.offsets.begin(), graph.offsets.end() - 1);
  for (std::size_t e = 0; e < reverse.size(); ++e) {
    reverse[e] = next[static_cast<std::size_t>(graph.neighbors[e])]++;
  }
  return reverse;
}

}  // namespace

std::vector<Block> divide(const torch::Tensor& grey, const QuadtreeOptions& options) {
  TORCH_CHECK(grey.dim() == 2 && grey.scalar_type() == torch::kFloat32 && grey.is_contiguous() &&
                  grey.device().is_cpu(),
              "quadtree: the picture must be [H,W] float32 on the CPU");
  TORCH_CHECK(is_power_of_two(options.largest_px) && is_power_of_two(options.smallest_px) &&
                  options.smallest_px <= options.largest_px,
              "quadtree: block sizes must be powers of two, not ", options.smallest_px, " to ",
              options.largest_px);
  const std::int64_t side = options.largest_px;
  const std::int64_t count = (grey.size(0) + side - 1) / side;
  std::vector<std::vector<Block>> strips(static_cast<std::size_t>(count));
  at::parallel_for(0, count, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) {
      strips[static_cast<std::size_t>(i)] =
          Divider(grey, options).divide(static_cast<int>(i * side));
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
  const Owners owners(blocks, width, height);
  graph.offsets.reserve(blocks.size() + 1);
  std::vector<std::int32_t>& all = graph.neighbors;
  all.reserve(kUsualNeighbors * blocks.size());
  for (const Block& b : blocks) {  // from one neighbour along each side to the next
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

}  // namespace apvi::mapping
