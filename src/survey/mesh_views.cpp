// SPDX-License-Identifier: BSD-3-Clause
#include "survey/mesh_views.hpp"

#include <torch/torch.h>

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

/// `depth` [H,W] changed by `change` [h,w]; 0 where that is unknown.
Tensor changed(const Tensor& depth, const Tensor& change) {
  const Tensor factor = 1.0 + change.to(depth.device(), torch::kFloat32);
  const Tensor fine = resized(factor, depth.size(0), depth.size(1)).to(depth.scalar_type());
  return torch::where(fine.isnan(), torch::zeros_like(depth), depth * fine);
}

/// Depth [H,W] where it can be relied on, elsewhere 0.
Tensor kept_depth(const mapping::Map& map, const SurveyView& view,
                  const mapping::MapRendering& drawn) {
  Tensor depth = mapping::surface_depth(map, view.camera, drawn.depth, drawn.alpha);
  if (view.depth_change.defined()) depth = changed(depth, view.depth_change);
  const Tensor solid = (drawn.alpha >= kKnownAlpha) & (depth > 0.0);
  const Tensor known = depth.index({solid});
  const double farthest = known.numel() == 0 ? 0.0 : kFar * known.median().item<double>();
  return depth * (solid & ~edges(depth) & (depth < farthest));
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
  return kept_depth(map, view, mapping::render_map(map, view.camera)).to(torch::kFloat32);
}

MeshView mesh_view(const mapping::Map& map, const SurveyView& view, const ColorRule& colors) {
  const torch::NoGradGuard no_grad;
  const mapping::MapRendering drawn = mapping::render_map(map, view.camera);
  const Tensor light = drawn.restored / drawn.alpha.clamp_min(kKnownAlpha).unsqueeze(2);
  return {.color = (colors(light) * 255.0 + 0.5).to(torch::kCPU, torch::kUInt8).contiguous(),
          .depth = kept_depth(map, view, drawn).to(torch::kCPU, torch::kFloat32).contiguous()};
}

}  // namespace apvi::survey
