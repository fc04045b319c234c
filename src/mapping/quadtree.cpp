// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/quadtree.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <utility>

namespace apvi::mapping {
namespace {

bool is_power_of_two(int n) {
  return n > 0 && (n & (n - 1)) == 0;
}

class Divider {
 public:
  Divider(const torch::Tensor& grey, const QuadtreeOptions& options)
      : pixels_(grey.data_ptr<float>()),
        width_(static_cast<int>(grey.size(1))),
        height_(static_cast<int>(grey.size(0))),
        options_(options) {}

  std::vector<Block> divide() {
    for (int y = 0; y < height_; y += options_.largest_px) {
      for (int x = 0; x < width_; x += options_.largest_px) add(x, y, options_.largest_px);
    }
    return std::move(blocks_);
  }

 private:
  void add(int x, int y, int size) {
    if (x >= width_ || y >= height_) return;
    const Block block = {.x = x,
                         .y = y,
                         .size = size,
                         .width = std::min(size, width_ - x),
                         .height = std::min(size, height_ - y)};
    if (size <= options_.smallest_px || is_even(block)) {
      blocks_.push_back(block);
      return;
    }
    const int half = size / 2;
    for (const auto& [dx, dy] : {std::pair{0, 0}, {half, 0}, {0, half}, {half, half}}) {
      add(x + dx, y + dy, half);
    }
  }

  /// Whether all pixels are within the threshold of their mean.
  bool is_even(const Block& block) const {
    float least = pixels_[block.y * width_ + block.x];
    float most = least;
    double sum = 0.0;
    for (int y = block.y; y < block.y + block.height; ++y) {
      const float* const row = pixels_ + static_cast<std::ptrdiff_t>(y) * width_;
      for (int x = block.x; x < block.x + block.width; ++x) {
        least = std::min(least, row[x]);
        most = std::max(most, row[x]);
        sum += static_cast<double>(row[x]);
      }
    }
    const double mean = sum / (block.width * block.height);
    return std::max(most - mean, mean - least) <= options_.threshold;
  }

  const float* pixels_;
  int width_;
  int height_;
  QuadtreeOptions options_;
  std::vector<Block> blocks_;
};

/// Which block each pixel belongs to.
std::vector<std::int32_t> owners(const std::vector<Block>& blocks, int width, int height) {
  std::vector<std::int32_t> owner(static_cast<std::size_t>(width) *
                                  static_cast<std::size_t>(height));
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const Block& b = blocks[i];
    for (int y = b.y; y < b.y + b.height; ++y) {
      std::fill_n(owner.begin() + static_cast<std::ptrdiff_t>(y) * width + b.x, b.width,
                  static_cast<std::int32_t>(i));
    }
  }
  return owner;
}

/// The same edge seen from its other end.
std::vector<std::int32_t> reverse_edges(const BlockGraph& graph) {
  std::vector<std::int32_t> reverse(graph.neighbors.size());
  for (std::size_t i = 0; i + 1 < graph.offsets.size(); ++i) {
    for (auto e = graph.offsets[i]; e < graph.offsets[i + 1]; ++e) {
      const auto other = static_cast<std::size_t>(graph.neighbors[static_cast<std::size_t>(e)]);
      const auto begin = graph.neighbors.begin() + graph.offsets[other];
      const auto end = graph.neighbors.begin() + graph.offsets[other + 1];
      const auto back = std::lower_bound(begin, end, static_cast<std::int32_t>(i));
      reverse[static_cast<std::size_t>(e)] =
          static_cast<std::int32_t>(back - graph.neighbors.begin());
    }
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
  return Divider(grey, options).divide();
}

BlockGraph neighbor_graph(const std::vector<Block>& blocks, int width, int height) {
  const std::vector<std::int32_t> owner = owners(blocks, width, height);
  const auto at = [&](int x, int y) {
    return owner[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                 static_cast<std::size_t>(x)];
  };
  BlockGraph graph;
  graph.offsets = {0};
  std::vector<std::int32_t>& all = graph.neighbors;
  for (const Block& b : blocks) {  // from one neighbour along each side to the next
    const auto first = static_cast<std::ptrdiff_t>(all.size());
    for (const int x : {b.x - 1, b.x + b.width}) {
      for (int y = b.y; x >= 0 && x < width && y < b.y + b.height;) {
        all.push_back(at(x, y));
        const Block& other = blocks[static_cast<std::size_t>(all.back())];
        y = other.y + other.height;
      }
    }
    for (const int y : {b.y - 1, b.y + b.height}) {
      for (int x = b.x; y >= 0 && y < height && x < b.x + b.width;) {
        all.push_back(at(x, y));
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
