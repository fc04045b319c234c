// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/blocks/block_views.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "mapping/density/seeds.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr int kSampleColumns = 40;   // of the small rendering that is sampled
constexpr double kSolidAlpha = 0.5;  // of a surface
constexpr double kBorder = 0.15;     // of the image size, by which Gaussians reach into an image
constexpr std::int64_t kChunk = 1 << 20;

gaussians::View small(const gaussians::View& view) {
  gaussians::View result = view;
  const gaussians::Intrinsics& camera = view.intrinsics;
  const int width = std::min(camera.width, kSampleColumns);
  const int height = std::max(1, camera.height * width / camera.width);
  result.intrinsics = camera.scaled(width, height);
  return result;
}

/// The view with a border around its image.
gaussians::View widened(const gaussians::View& view) {
  gaussians::View result = view;
  gaussians::Intrinsics& camera = result.intrinsics;
  const int x = static_cast<int>(kBorder * camera.width);
  const int y = static_cast<int>(kBorder * camera.height);
  camera.cx += x;
  camera.cy += y;
  camera.width += 2 * x;
  camera.height += 2 * y;
  return result;
}

}  // namespace

Tensor surface_points(const Map& map, const gaussians::View& view) {
  const gaussians::View camera = small(view);
  const MapRendering rendering = render_map(map, camera);
  const Tensor solid = (rendering.alpha > kSolidAlpha).reshape({-1}).nonzero().squeeze(1).cpu();
  const Tensor depths =
      rendering.depth.reshape({-1}).cpu().index_select(0, solid).to(torch::kFloat64);
  const std::int64_t width = camera.intrinsics.width;
  const Tensor pixels = torch::stack({solid.remainder(width).to(torch::kFloat64) + 0.5,
                                      solid.floor_divide(width).to(torch::kFloat64) + 0.5},
                                     1);
  return world_points(camera, pixels, depths);
}

Tensor block_shares(const BlockPartition& partition, const Tensor& points) {
  const Tensor counts = partition.block_of(points).bincount({}, partition.size());
  return counts.to(torch::kFloat64) /
         static_cast<double>(std::max<std::int64_t>(1, points.size(0)));
}

Tensor near_any_view(const Tensor& means, const std::vector<gaussians::View>& views) {
  const torch::NoGradGuard no_grad;
  std::vector<gaussians::View> cameras;
  for (const gaussians::View& view : views) {
    cameras.push_back(widened(view));
    cameras.back().T_camera_world = cameras.back().T_camera_world.to(means.device());
  }
  std::vector<Tensor> parts = {torch::empty({0}, means.options().dtype(torch::kBool))};
  for (std::int64_t first = 0; first < means.size(0); first += kChunk) {
    const Tensor chunk = means.slice(0, first, first + kChunk).to(torch::kFloat64);
    Tensor near = torch::zeros({chunk.size(0)}, means.options().dtype(torch::kBool));
    for (const gaussians::View& camera : cameras) {
      near.logical_or_(project(camera, chunk).in_view);
    }
    parts.push_back(near);
  }
  return torch::cat(parts);
}

}  // namespace apvi::mapping
