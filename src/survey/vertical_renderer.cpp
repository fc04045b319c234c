// SPDX-License-Identifier: BSD-3-Clause
#include "survey/vertical_renderer.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <limits>

#include "gaussians/model/point_cloud.hpp"
#include "gaussians/model/quaternions.hpp"
#include "gaussians/render/render.hpp"
#include "gaussians/render/sh_math.hpp"
#include "mapping/surface_depth.hpp"
#include "survey/crs_points.hpp"

namespace apvi::survey {
namespace {

using gaussians::Gaussians;
using torch::Tensor;

constexpr double kReachSigmas = 3.4;    // a little beyond where an opaque Gaussian reaches 1/255
constexpr double kReachPx = 2.0;        // the same of the low-pass
constexpr double kMinSigma_m = 1e-9;    // thinner footprints are lines
constexpr double kMinRelief_m = 1e-3;   // of a tile
constexpr std::int64_t kMarginPx = 16;  // around a tile, for slopes at its edges
constexpr double kFlat = -30.0;         // logarithm of a thickness of nothing

/// Horizontal covariances [N,2,2]: east and south.
Tensor footprints(const SurveyMap& map) {
  const Gaussians& g = map.map.gaussians;
  Tensor horizontal = crs_rotation(map).slice(0, 0, 2).clone();
  horizontal[1].neg_();
  const Tensor axes =
      torch::matmul(horizontal, gaussians::rotations_of(g.quaternions.to(torch::kFloat64))) *
      g.log_scales.to(torch::kFloat64).exp().unsqueeze(1);
  return torch::matmul(axes, axes.transpose(1, 2));
}

gaussians::View view_of(const GroundGrid& tile) {
  gaussians::View view;
  view.intrinsics = {.fx = 1.0 / tile.resolution_m,
                     .fy = 1.0 / tile.resolution_m,
                     .cx = 0.5 * static_cast<double>(tile.width),
                     .cy = 0.5 * static_cast<double>(tile.height),
                     .width = static_cast<int>(tile.width),
                     .height = static_cast<int>(tile.height)};
  view.T_camera_world = torch::eye(4, torch::kFloat64);
  return view;
}

/// The grid with a margin on all sides.
GroundGrid with_margin(const GroundGrid& grid, std::int64_t pixels) {
  const double margin = static_cast<double>(pixels) * grid.resolution_m;
  return {grid.west - margin, grid.north + margin, grid.resolution_m, grid.width + 2 * pixels,
          grid.height + 2 * pixels};
}

}  // namespace

Tensor light_from_above(const SurveyMap& map) {
  const Gaussians& g = map.map.gaussians;
  const Eigen::Vector3d down = map.T_crs_map.rotation.conjugate() * -Eigen::Vector3d::UnitZ();
  std::array<double, gaussians::kMaxShRest> basis{};
  gaussians::sh_basis(g.sh_degree(), down.x(), down.y(), down.z(), basis.data());
  const Tensor weights =
      torch::tensor(at::ArrayRef<double>(basis.data(), basis.size()), g.sh_dc.options())
          .slice(0, 0, g.sh_rest.size(1));
  const Tensor constant = gaussians::sh_dc_to_color(g.sh_dc);
  return (constant + (g.sh_rest * weights.view({1, -1, 1})).sum(1)).clamp_min(0.0).detach();
}

VerticalRenderer::VerticalRenderer(const SurveyMap& map)
    : anchor_(map.T_crs_map.translation), antialiased_(map.map.antialiased) {
  const torch::NoGradGuard no_grad;
  positions_ = crs_points(map, anchor_);
  const Tensor covariance = footprints(map);
  const Tensor a = covariance.select(1, 0).select(1, 0);
  const Tensor b = covariance.select(1, 0).select(1, 1);
  const Tensor c = covariance.select(1, 1).select(1, 1);
  const Tensor spread = torch::hypot(0.5 * (a - c), b);
  const Tensor middle = 0.5 * (a + c);
  sigmas_ = torch::stack({middle + spread, middle - spread}, 1)
                .clamp_min(kMinSigma_m * kMinSigma_m)
                .sqrt();
  angles_ = 0.5 * torch::atan2(2.0 * b, a - c);
  opacities_ = map.map.gaussians.logit_opacities.detach();
  colors_ = gaussians::color_to_sh_dc(light_from_above(map));
}

Tensor VerticalRenderer::near(const GroundGrid& tile) const {
  const double half_x = 0.5 * static_cast<double>(tile.width) * tile.resolution_m;
  const double half_y = 0.5 * static_cast<double>(tile.height) * tile.resolution_m;
  const Tensor reach = kReachSigmas * sigmas_.select(1, 0) + kReachPx * tile.resolution_m;
  const Tensor x = positions_.select(1, 0) - (tile.west + half_x - anchor_.x());
  const Tensor y = positions_.select(1, 1) - (tile.north - half_y - anchor_.y());
  return ((x.abs() < reach + half_x) & (y.abs() < reach + half_y)).nonzero().squeeze(1);
}

VerticalView VerticalRenderer::pinhole(const GroundGrid& tile) const {
  const torch::NoGradGuard no_grad;
  VerticalView out{.map = {}, .view = view_of(tile)};
  const Tensor rows = near(tile);
  const auto options = colors_.options();
  const Tensor positions = positions_.index_select(0, rows);
  const Tensor heights = positions.select(1, 2);
  if (rows.size(0) > 0) {
    out.top_m = heights.max().item<double>();
    out.relief_m = std::max(kMinRelief_m, out.top_m - heights.min().item<double>());
  }
  const Tensor depth = 1.0 + 0.5 * (out.top_m - heights) / out.relief_m;
  const Tensor x = positions.select(1, 0) - (0.5 * (tile.west + tile.east()) - anchor_.x());
  const Tensor y = (0.5 * (tile.north + tile.south()) - anchor_.y()) - positions.select(1, 1);
  const Tensor sigmas = sigmas_.index_select(0, rows) * depth.unsqueeze(1);
  const Tensor half_angle = 0.5 * angles_.index_select(0, rows);
  const Tensor zero = torch::zeros_like(depth);
  const Tensor flat = torch::full_like(depth, kFlat).unsqueeze(1);
  const auto as_map = [&](const Tensor& t) { return t.to(options.dtype()).contiguous(); };
  out.map.antialiased = antialiased_;
  out.map.gaussians = {
      .means = as_map(torch::stack({x * depth, y * depth, depth}, 1)),
      .log_scales = as_map(torch::cat({sigmas.log(), flat}, 1)),
      .quaternions = as_map(torch::stack({half_angle.cos(), zero, zero, half_angle.sin()}, 1)),
      .logit_opacities = opacities_.index_select(0, rows),
      .sh_dc = colors_.index_select(0, rows),
      .sh_rest = torch::zeros({rows.size(0), 0, 3}, options)};
  return out;
}

GroundImage VerticalRenderer::render(const GroundGrid& tile) const {
  const torch::NoGradGuard no_grad;
  const VerticalView seen = pinhole(with_margin(tile, kMarginPx));
  const mapping::MapRendering drawn = mapping::render_map(seen.map, seen.view);
  const Tensor surface = mapping::surface_depth(seen.map, seen.view, drawn.depth, drawn.alpha);
  const auto inner = [&](const Tensor& image) {
    return image.slice(0, kMarginPx, kMarginPx + tile.height)
        .slice(1, kMarginPx, kMarginPx + tile.width);
  };
  const Tensor known = inner(drawn.alpha) >= kKnownAlpha;
  const Tensor color =
      inner(drawn.restored) / inner(drawn.alpha).clamp_min(kKnownAlpha).unsqueeze(2);
  const Tensor elevation = seen.height(inner(surface).to(torch::kFloat64)) + anchor_.z();
  return {torch::where(known.unsqueeze(2), color, torch::zeros_like(color)),
          elevation.masked_fill(~known, std::numeric_limits<double>::quiet_NaN()), known};
}

}  // namespace apvi::survey
