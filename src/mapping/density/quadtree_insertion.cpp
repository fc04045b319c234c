// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/quadtree_insertion.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cstddef>
#include <map>
#include <vector>

namespace apvi::mapping {
namespace {

using torch::Tensor;

// Number of points [n,2] in each pixel.
Tensor histogram(const Tensor& points, std::int64_t height, std::int64_t width) {
  const Tensor u = points.select(1, 0).floor().to(torch::kInt64);
  const Tensor v = points.select(1, 1).floor().to(torch::kInt64);
  const Tensor inside = (u >= 0) & (v >= 0) & (u < width) & (v < height);
  const Tensor index = (v * width + u).index({inside});
  return torch::bincount(index, {}, height * width).view({height, width}).to(torch::kFloat32);
}

// Means [C,n] of images over blocks, pixel by pixel.
Tensor summed_means(const Tensor& images, const std::vector<depth::Block>& blocks,
                    const std::vector<std::int64_t>& members) {
  const Tensor host = images.to(torch::kCPU);
  const auto pixel = host.accessor<float, 3>();
  Tensor means = torch::empty({images.size(0), static_cast<std::int64_t>(members.size())});
  auto mean = means.accessor<float, 2>();
  for (std::int64_t c = 0; c < means.size(0); ++c) {
    for (std::int64_t k = 0; k < means.size(1); ++k) {
      const auto& b = blocks[static_cast<std::size_t>(members[static_cast<std::size_t>(k)])];
      double sum = 0.0;
      for (int y = b.y; y < b.y + b.height; ++y) {
        for (int x = b.x; x < b.x + b.width; ++x) sum += static_cast<double>(pixel[c][y][x]);
      }
      mean[c][k] = static_cast<float>(sum / (b.width * b.height));
    }
  }
  return means.to(images.device());
}

// The same if every block is a pixel of the image downscaled by `size`; the last row and column may
// be incomplete.
Tensor pooled_means(const Tensor& images, const std::vector<depth::Block>& blocks,
                    const std::vector<std::int64_t>& members, int size) {
  const Tensor reduced = torch::avg_pool2d(images, size, size, 0, /*ceil_mode=*/true);
  std::vector<std::int64_t> pixels;
  pixels.reserve(members.size());
  for (const std::int64_t i : members) {
    const depth::Block& b = blocks[static_cast<std::size_t>(i)];
    pixels.push_back(b.y / size * reduced.size(2) + b.x / size);
  }
  return reduced.flatten(1).index_select(1,
                                         torch::tensor(pixels, torch::kInt64).to(images.device()));
}

bool is_power_of_two(int number) {
  return number > 0 && (number & (number - 1)) == 0;
}

}  // namespace

// Blocks lie on a grid of their size if it is a power of two (see depth::build_quadtree).
Tensor block_means(const Tensor& images, const std::vector<depth::Block>& blocks) {
  std::map<int, std::vector<std::int64_t>> by_size;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    by_size[blocks[i].size].push_back(static_cast<std::int64_t>(i));
  }
  const auto count = static_cast<std::int64_t>(blocks.size());
  Tensor means = torch::empty({images.size(0), count}, images.options());
  for (const auto& [size, members] : by_size) {
    const Tensor index = torch::tensor(members, torch::kInt64).to(images.device());
    means.index_copy_(1, index,
                      is_power_of_two(size) ? pooled_means(images, blocks, members, size)
                                            : summed_means(images, blocks, members));
  }
  return means;
}

Tensor insertion_depths(const depth::DepthEstimate& estimate, InsertionDepth source) {
  if (source == InsertionDepth::block) {
    return torch::where(estimate.confident, estimate.depth, torch::zeros_like(estimate.depth));
  }
  const Tensor pixels = estimate.points.to(torch::kInt64);  // points are inside the image
  return estimate.dense.index({pixels.select(1, 1), pixels.select(1, 0)});
}

Tensor blocks_to_fill(const depth::DepthEstimate& estimate, const Tensor& depths,
                      const Tensor& points, const Tensor& rendered, const Tensor& alpha,
                      const Tensor& image, const OnlineOptions& options) {
  const Tensor error = (rendered - image).abs().mean(2);
  const Tensor counts = histogram(points, alpha.size(0), alpha.size(1)).to(alpha.device());
  const Tensor means = block_means(torch::stack({alpha, error, counts}), estimate.blocks);
  const Tensor covered =
      (means[0] >= options.coverage_min_alpha) & (means[1] <= options.coverage_max_error);
  const Tensor needed = (means[2] == 0.0) & ~covered;
  return (depths > 0) & needed.to(torch::kCPU);
}

Tensor blocks_in_scene(const Tensor& scene, const std::vector<depth::Block>& blocks) {
  const Tensor hidden = scene.logical_not().to(torch::kFloat32).unsqueeze(0);
  return (block_means(hidden, blocks)[0] == 0.0).to(torch::kCPU);
}

Tensor in_free_space(const depth::DepthEstimate& estimate, const gaussians::View& view,
                     const Tensor& means, double depth_ratio) {
  const gaussians::Intrinsics& k = view.intrinsics;
  Tensor free = torch::zeros({k.height, k.width}, torch::kFloat32);
  const auto depth = estimate.depth.accessor<float, 1>();
  const auto confident = estimate.confident.accessor<bool, 1>();
  for (std::size_t i = 0; i < estimate.blocks.size(); ++i) {
    const depth::Block& b = estimate.blocks[i];
    const auto number = static_cast<std::int64_t>(i);
    if (!confident[number]) continue;
    for (int y = b.y; y < b.y + b.height; ++y) {
      float* const row = free.data_ptr<float>() + static_cast<std::ptrdiff_t>(y) * k.width;
      std::fill_n(row + b.x, b.width, static_cast<float>(depth_ratio) * depth[number]);
    }
  }
  gaussians::View device_view = view;
  device_view.T_camera_world = view.T_camera_world.to(means.options());
  const ProjectedPoints seen = project(device_view, means);
  const Tensor limit =
      free.to(means.device()).reshape({-1}).index_select(0, pixel_index(k, seen.pixels));
  return seen.in_view & (seen.depths < limit);
}

Seeds seeds_from_blocks(const depth::DepthEstimate& estimate, const Tensor& depths,
                        const Tensor& which, double opacity) {
  const Tensor index = which.nonzero().squeeze(1);
  const std::int64_t n = index.size(0);
  Tensor size = torch::empty({static_cast<std::int64_t>(estimate.blocks.size())}, torch::kFloat64);
  for (std::size_t i = 0; i < estimate.blocks.size(); ++i) {
    size.data_ptr<double>()[i] = estimate.blocks[i].size;
  }
  return {.pixels = estimate.points.index_select(0, index).to(torch::kFloat64),
          .depths = depths.index_select(0, index).to(torch::kFloat64),
          .radii_px = 0.5 * size.index_select(0, index),
          .opacities = torch::full({n}, opacity, torch::kFloat64)};
}

}  // namespace apvi::mapping
