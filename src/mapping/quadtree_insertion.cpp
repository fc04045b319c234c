// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/quadtree_insertion.hpp"

#include <torch/torch.h>

namespace apvi::mapping {
namespace {

using torch::Tensor;

// Column and row of the first pixel and of the one behind the last, [B] int64 each.
struct Edges {
  Tensor left, top, right, bottom;
};

Edges edges_of(const std::vector<Block>& blocks) {
  const auto n = static_cast<std::int64_t>(blocks.size());
  Tensor all = torch::empty({4, n}, torch::kInt64);
  auto row = all.accessor<std::int64_t, 2>();
  for (std::int64_t i = 0; i < n; ++i) {
    const Block& b = blocks[static_cast<std::size_t>(i)];
    row[0][i] = b.x;
    row[1][i] = b.y;
    row[2][i] = b.x + b.width;
    row[3][i] = b.y + b.height;
  }
  return {.left = all[0], .top = all[1], .right = all[2], .bottom = all[3]};
}

// How many of the points [n,2] lie in each pixel.
Tensor histogram(const Tensor& points, std::int64_t height, std::int64_t width) {
  const Tensor u = points.select(1, 0).floor().to(torch::kInt64);
  const Tensor v = points.select(1, 1).floor().to(torch::kInt64);
  const Tensor inside = (u >= 0) & (v >= 0) & (u < width) & (v < height);
  const Tensor index = (v * width + u).index({inside});
  return torch::bincount(index, {}, height * width).view({height, width}).to(torch::kFloat32);
}

}  // namespace

Tensor block_means(const Tensor& image, const std::vector<Block>& blocks) {
  const Edges e = edges_of(blocks);
  const std::int64_t stride = image.size(1) + 1;
  Tensor sums = torch::zeros({image.size(0) + 1, stride}, torch::kFloat64);
  sums.slice(0, 1).slice(1, 1).copy_(image.to(torch::kFloat64).cumsum(0).cumsum(1));
  const Tensor flat = sums.reshape({-1});
  const auto at = [&](const Tensor& y, const Tensor& x) {
    return flat.index_select(0, y * stride + x);
  };
  const Tensor sum =
      at(e.bottom, e.right) - at(e.top, e.right) - at(e.bottom, e.left) + at(e.top, e.left);
  return sum / ((e.right - e.left) * (e.bottom - e.top)).to(torch::kFloat64);
}

Tensor blocks_to_fill(const DepthEstimate& estimate, const Tensor& points, const Tensor& drawn,
                      const Tensor& alpha, const Tensor& picture, const OnlineOptions& options) {
  const Tensor error = (drawn - picture).abs().mean(2);
  const Tensor dense = block_means(alpha, estimate.blocks) >= options.covered_alpha;
  const Tensor right = block_means(error, estimate.blocks) <= options.covered_error;
  const Tensor counts = histogram(points, alpha.size(0), alpha.size(1));
  const Tensor empty = block_means(counts, estimate.blocks) == 0.0;
  return estimate.confident & (estimate.depth > 0) & empty & ~(dense & right);
}

Seeds seeds_of_blocks(const DepthEstimate& estimate, const Tensor& which, double opacity) {
  const Tensor index = which.nonzero().squeeze(1);
  const std::int64_t n = index.size(0);
  Tensor size = torch::empty({static_cast<std::int64_t>(estimate.blocks.size())}, torch::kFloat64);
  for (std::size_t i = 0; i < estimate.blocks.size(); ++i) {
    size.data_ptr<double>()[i] = estimate.blocks[i].size;
  }
  return {.pixels = estimate.points.index_select(0, index).to(torch::kFloat64),
          .depths = estimate.depth.index_select(0, index).to(torch::kFloat64),
          .radii_px = 0.5 * size.index_select(0, index),
          .opacities = torch::full({n}, opacity, torch::kFloat64)};
}

}  // namespace apvi::mapping
