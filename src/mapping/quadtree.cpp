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
  std::vector<std::pair<std::int32_t, std::int32_t>> edges;
  for (std::size_t i = 0; i < blocks.size(); ++i) {  // what lies to the right of and below each
    const Block& b = blocks[i];
    const auto self = static_cast<std::int32_t>(i);
    const auto touch = [&](std::int32_t other) {
      if (!edges.empty() && edges.back() == std::pair{other, self}) return;
      edges.emplace_back(self, other);
      edges.emplace_back(other, self);
    };
    for (int y = b.y; b.x + b.width < width && y < b.y + b.height; ++y) touch(at(b.x + b.width, y));
    for (int x = b.x; b.y + b.height < height && x < b.x + b.width; ++x) {
      touch(at(x, b.y + b.height));
    }
  }
  std::sort(edges.begin(), edges.end());
  BlockGraph graph;
  graph.offsets.assign(blocks.size() + 1, 0);
  for (const auto& [from, to] : edges) {
    ++graph.offsets[static_cast<std::size_t>(from) + 1];
    graph.neighbors.push_back(to);
    const auto back = std::lower_bound(edges.begin(), edges.end(), std::pair{to, from});
    graph.reverse.push_back(static_cast<std::int32_t>(back - edges.begin()));
  }
  for (std::size_t i = 0; i < blocks.size(); ++i) graph.offsets[i + 1] += graph.offsets[i];
  return graph;
}

}  // namespace apvi::mapping
