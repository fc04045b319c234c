// SPDX-License-Identifier: BSD-3-Clause
#include "change/surface_view.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "gaussians/model/point_cloud.hpp"
#include "gaussians/render/render.hpp"
#include "mapping/blur.hpp"
#include "mapping/surface_depth.hpp"

namespace apvi::change {
namespace {

using torch::Tensor;

constexpr double kOpaque = 0.8;
constexpr double kFar = 3.0;       // times the median depth
constexpr double kMaxSlope = 4.0;  // tangent of the angle between ray and normal: 76 degrees
constexpr double kSlopePx = 1.5;   // blur before differentiation
constexpr double kColorPx = 1.5;   // blur of colors
constexpr double kCoarsePx = 4.0;  // of the details; the background has twice the blur
constexpr double kFinePx = 1.5;

/// Pixels [H,W] next to a jump of the depth.
Tensor edges(const Tensor& depth, double focal) {
  Tensor out = torch::zeros_like(depth, torch::kBool);
  for (const std::int64_t axis : {0, 1}) {
    const std::int64_t last = depth.size(axis) - 1;
    const Tensor a = depth.narrow(axis, 0, last);
    const Tensor b = depth.narrow(axis, 1, last);
    const Tensor step = (a - b).abs() > kMaxSlope / focal * torch::minimum(a, b);
    out.narrow(axis, 0, last).logical_or_(step);
    out.narrow(axis, 1, last).logical_or_(step);
  }
  return out;
}

/// Central differences [H,W] along an axis, zero at the border.
Tensor slope(const Tensor& image, std::int64_t axis) {
  Tensor out = torch::zeros_like(image);
  const std::int64_t inner = image.size(axis) - 2;
  if (inner < 1) return out;
  out.narrow(axis, 1, inner)
      .copy_(0.5 * (image.narrow(axis, 2, inner) - image.narrow(axis, 0, inner)));
  return out;
}

/// Rays (x, y, 1) of the pixels [H,W,3].
Tensor rays(const gaussians::Intrinsics& k, const torch::TensorOptions& options) {
  const Tensor x = (torch::arange(k.width, options) + 0.5 - k.cx) / k.fx;
  const Tensor y = (torch::arange(k.height, options) + 0.5 - k.cy) / k.fy;
  return torch::stack(
      {x.unsqueeze(0).expand({k.height, k.width}), y.unsqueeze(1).expand({k.height, k.width}),
       torch::ones({k.height, k.width}, options)},
      2);
}

Tensor planes_of(const Tensor& depth, const gaussians::Intrinsics& k) {
  const Tensor smooth = mapping::blurred_inverse_depth(depth, kSlopePx);
  const Tensor a = slope(smooth, 1) * k.fx;
  const Tensor b = slope(smooth, 0) * k.fy;
  const Tensor r = rays(k, depth.options());
  const Tensor c = depth.clamp_min(1e-6).reciprocal() - a * r.select(2, 0) - b * r.select(2, 1);
  return torch::stack({a, b, c}, 2);
}

Tensor blurred_channels(const Tensor& image, double sigma) {
  return mapping::blurred(image.permute({2, 0, 1}).unsqueeze(1), sigma)
      .squeeze(1)
      .permute({1, 2, 0});
}

Tensor band(const Tensor& brightness, double sigma) {
  return blurred_channels(brightness, sigma) - blurred_channels(brightness, 2.0 * sigma);
}

/// Standard deviation [H,W] of the depths of the Gaussians that make up each pixel [m]: small on a
/// surface, large where the images have not decided where it is. Painted like colors.
Tensor depth_spread(const mapping::Map& map, const gaussians::View& view, const Tensor& depth,
                    const Tensor& alpha) {
  const double unit = std::max(1e-3, depth.max().item<double>());
  const auto [R, t] = camera_pose(view, map.gaussians.means);
  const Tensor z = (map.gaussians.means.matmul(R[2]) + t[2]).div(unit).clamp(0.0, 1.0);
  gaussians::Gaussians painted = map.gaussians;
  painted.sh_dc = gaussians::color_to_sh_dc(torch::stack({z, z.square(), z}, 1));
  const Tensor drawn =
      gaussians::render(painted, view,
                        {.sh_degree = 0, .antialiased = map.antialiased, .background = {}})
          .color;
  const Tensor mean = drawn / alpha.clamp_min(kOpaque).unsqueeze(2);
  return unit * (mean.select(2, 1) - mean.select(2, 0).square()).clamp_min(0.0).sqrt();
}

Tensor reliable(const Tensor& depth, const Tensor& alpha, double focal) {
  const Tensor solid = (alpha >= kOpaque) & (depth > 0.0);
  const Tensor known = depth.index({solid});
  const double farthest = known.numel() == 0 ? 0.0 : kFar * known.median().item<double>();
  return solid & (depth < farthest) & ~edges(depth, focal);
}

/// Logarithm [H,W,3] of the light.
Tensor logarithm_of(const mapping::MapRendering& drawn, double black) {
  const Tensor light = drawn.restored / drawn.alpha.clamp_min(kOpaque).unsqueeze(2);
  return (light.clamp_min(0.0) + black).log();
}

mapping::Map without_water(const mapping::Map& map) {
  return {.gaussians = map.gaussians, .medium = {}, .antialiased = map.antialiased};
}

}  // namespace

ViewLight view_light(const mapping::Map& map, const gaussians::View& view, double black) {
  const torch::NoGradGuard no_grad;
  const mapping::MapRendering drawn = mapping::render_map(without_water(map), view);
  const Tensor color = blurred_channels(logarithm_of(drawn, black), kColorPx);
  return {color.reshape({-1, 3}).contiguous(), (drawn.alpha >= kOpaque).flatten()};
}

SurfaceView surface_view(const mapping::Map& map, const gaussians::View& view, double black) {
  const torch::NoGradGuard no_grad;
  const mapping::Map bare = without_water(map);
  const mapping::MapRendering drawn = mapping::render_map(bare, view);
  const gaussians::Intrinsics& k = view.intrinsics;
  const Tensor depth = mapping::surface_depth(bare, view, drawn.depth, drawn.alpha);
  const Tensor good = reliable(depth, drawn.alpha, k.fx);
  const Tensor planes = planes_of(depth, k) * good.unsqueeze(2);
  const Tensor facing = (depth * planes.norm(2, 2)).clamp_min(1.0).reciprocal();
  const Tensor spread = facing * depth_spread(bare, view, depth, drawn.alpha);
  const Tensor logarithm = logarithm_of(drawn, black);
  const Tensor brightness = logarithm.mean(2, true);
  const std::int64_t n = depth.numel();
  const auto flat = [n](const Tensor& image) { return image.reshape({n, -1}).contiguous(); };
  return {.view = view,
          .planes = flat(planes),
          .color = flat(blurred_channels(logarithm, kColorPx)),
          .detail = flat(torch::cat({band(brightness, kCoarsePx), band(brightness, kFinePx)}, 2)),
          .spread = spread.flatten()};
}

SurfacePixels surface_pixels(const SurfaceView& view) {
  const Tensor pixels = view.planes.abs().sum(1).nonzero().squeeze(1);
  const Tensor r =
      rays(view.view.intrinsics, view.planes.options()).view({-1, 3}).index_select(0, pixels);
  const Tensor inverse = (view.planes.index_select(0, pixels) * r).sum(1, true);
  return {pixels, r / inverse};
}

CameraPose camera_pose(const gaussians::View& view, const Tensor& like) {
  const Tensor T = view.T_camera_world.to(like.options());
  return {T.slice(0, 0, 3).slice(1, 0, 3), T.slice(0, 0, 3).select(1, 3)};
}

Observation observation(const SurfaceView& view, const Tensor& points) {
  const gaussians::Intrinsics& k = view.view.intrinsics;
  const auto [R, t] = camera_pose(view.view, points);
  const Tensor p = points.mm(R.t()) + t;
  const Tensor z = p.select(1, 2);
  const Tensor u = (k.fx * p.select(1, 0) / z + k.cx).floor();
  const Tensor v = (k.fy * p.select(1, 1) / z + k.cy).floor();
  const Tensor inside = (z > 0.0) & (u >= 0.0) & (u < k.width) & (v >= 0.0) & (v < k.height);
  const Tensor rows = inside.nonzero().squeeze(1);
  const Tensor pixels =
      (v.index_select(0, rows) * k.width + u.index_select(0, rows)).to(torch::kInt64);
  const Tensor planes = view.planes.index_select(0, pixels);
  const Tensor length = planes.norm(2, 1);
  const Tensor kept = (length > 0.0).nonzero().squeeze(1);
  const Tensor normals = planes.index_select(0, kept) / length.index_select(0, kept).unsqueeze(1);
  const Tensor seen = p.index_select(0, rows).index_select(0, kept);
  const Tensor distance = length.index_select(0, kept).reciprocal() - (normals * seen).sum(1);
  return {rows.index_select(0, kept), pixels.index_select(0, kept), seen, distance, normals};
}

}  // namespace apvi::change
