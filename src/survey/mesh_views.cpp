// SPDX-License-Identifier: BSD-3-Clause
#include "survey/mesh_views.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "mapping/surface_depth.hpp"
#include "survey/vertical_renderer.hpp"

namespace apvi::survey {
namespace {

using torch::Tensor;

constexpr double kMaxStep = 0.05;  // relative depth change from pixel to pixel
constexpr double kFar = 3.0;       // times the median depth

/// Pixels [H,W] whose depth differs from that of a neighbor as at a depth edge.
Tensor edges(const Tensor& depth) {
  Tensor out = torch::zeros_like(depth, torch::kBool);
  for (const std::int64_t axis : {0, 1}) {
    const std::int64_t last = depth.size(axis) - 1;
    const Tensor a = depth.narrow(axis, 0, last);
    const Tensor b = depth.narrow(axis, 1, last);
    const Tensor step = (a - b).abs() > kMaxStep * torch::minimum(a, b);
    out.narrow(axis, 0, last).logical_or_(step);
    out.narrow(axis, 1, last).logical_or_(step);
  }
  return out;
}

/// `depth` [H,W] where it is `solid`, without edges and what is far behind the rest; elsewhere 0.
Tensor kept(const Tensor& depth, const Tensor& solid) {
  const Tensor known = depth.index({solid});
  const double farthest = known.numel() == 0 ? 0.0 : kFar * known.median().item<double>();
  return depth * (solid & ~edges(depth) & (depth < farthest));
}

/// Depth [H,W] of a camera where the map shows a surface, elsewhere 0.
Tensor map_depth(const mapping::Map& map, const gaussians::View& camera,
                 const mapping::MapRendering& drawn) {
  const Tensor depth = mapping::surface_depth(map, camera, drawn.depth, drawn.alpha);
  return kept(depth, (drawn.alpha >= kKnownAlpha) & (depth > 0.0)).to(torch::kFloat32);
}

/// The pixels of an axis of a coarser image before and after each of `size` pixels.
struct Neighbors {
  Tensor before;  ///< [size] int64
  Tensor after;
  Tensor share;  ///< [size] float32 of `after`

  Neighbors(std::int64_t coarse, std::int64_t size, const torch::Device& device) {
    const double scale = static_cast<double>(coarse) / static_cast<double>(size);
    const Tensor at = (torch::arange(size, torch::kFloat64) + 0.5) * scale - 0.5;
    const std::int64_t last = std::max<std::int64_t>(0, coarse - 2);
    const Tensor first = at.floor().clamp(0, last);
    share = (at - first).to(device, torch::kFloat32);
    before = first.to(device, torch::kInt64);
    after = (before + 1).clamp_max(coarse - 1);
  }
};

/// `depth` [h,w] at a finer resolution: its inverse is linear on planes, so it is interpolated
/// within surfaces; elsewhere the nearest pixel counts.
Tensor finer(const Tensor& depth, std::int64_t height, std::int64_t width) {
  const Tensor inverse = torch::where(depth > 0.0, depth.reciprocal(), torch::zeros_like(depth));
  const Neighbors rows(depth.size(0), height, depth.device());
  const Neighbors columns(depth.size(1), width, depth.device());
  const auto corner = [&inverse](const Tensor& row, const Tensor& column) {
    return inverse.index_select(0, row).index_select(1, column);
  };
  const Tensor a = corner(rows.before, columns.before);
  const Tensor b = corner(rows.before, columns.after);
  const Tensor c = corner(rows.after, columns.before);
  const Tensor d = corner(rows.after, columns.after);
  const Tensor low = torch::minimum(torch::minimum(a, b), torch::minimum(c, d));
  const Tensor high = torch::maximum(torch::maximum(a, b), torch::maximum(c, d));
  const Tensor above = a + (b - a) * columns.share;
  const Tensor below = c + (d - c) * columns.share;
  const Tensor between = above + (below - above) * rows.share.unsqueeze(1);
  const Tensor one_surface = (low > 0.0) & (high < (1.0 + kMaxStep) * low) & (between > 0.0);
  return torch::where(one_surface, between.clamp_min(1e-9).reciprocal(),
                      resized(depth, height, width));
}

/// Depth of the coarser image of a view that `depth_change` is for.
Tensor changed_depth(const mapping::Map& map, const SurveyView& view) {
  gaussians::View coarse = view.camera;
  coarse.intrinsics = coarse.intrinsics.scaled(static_cast<int>(view.depth_change.size(1)),
                                               static_cast<int>(view.depth_change.size(0)));
  const Tensor depth = map_depth(map, coarse, mapping::render_map(map, coarse));
  const Tensor factor = 1.0 + view.depth_change.to(depth.device(), torch::kFloat32);
  return torch::where(factor.isnan(), torch::zeros_like(depth), depth * factor);
}

Tensor confirmed_depth(const mapping::Map& map, const SurveyView& view) {
  const gaussians::Intrinsics& k = view.camera.intrinsics;
  const Tensor depth = finer(changed_depth(map, view), k.height, k.width);
  return kept(depth, depth > 0.0).to(torch::kFloat32);
}

}  // namespace

Tensor resized(const Tensor& image, std::int64_t height, std::int64_t width) {
  const auto index = [&image](std::int64_t axis, std::int64_t size) {
    const double scale = static_cast<double>(image.size(axis)) / static_cast<double>(size);
    return ((torch::arange(size, torch::kFloat64) + 0.5) * scale)
        .floor()
        .to(image.device(), torch::kInt64);
  };
  return image.index_select(0, index(0, height)).index_select(1, index(1, width));
}

Tensor reliable_depth(const mapping::Map& map, const SurveyView& view) {
  const torch::NoGradGuard no_grad;
  return view.depth_change.defined()
             ? confirmed_depth(map, view)
             : map_depth(map, view.camera, mapping::render_map(map, view.camera));
}

MeshView mesh_view(const mapping::Map& map, const SurveyView& view, const ColorRule& colors) {
  const torch::NoGradGuard no_grad;
  const mapping::MapRendering drawn = mapping::render_map(map, view.camera);
  const Tensor light = drawn.restored / drawn.alpha.clamp_min(kKnownAlpha).unsqueeze(2);
  const Tensor depth =
      view.depth_change.defined() ? confirmed_depth(map, view) : map_depth(map, view.camera, drawn);
  return {.color = (colors(light) * 255.0 + 0.5).to(torch::kCPU, torch::kUInt8).contiguous(),
          .depth = depth.to(torch::kCPU).contiguous()};
}

}  // namespace apvi::survey
