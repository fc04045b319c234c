// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/surface_depth.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

#include "gaussians/render/render.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kSpacing = 0.04;  // [m] of the Gaussians on a surface
const gaussians::Intrinsics kCamera = {105.0, 105.0, 80.0, 60.0, 160, 120};

/// Isotropic Gaussians at points [n,3].
Map map_of(const Tensor& points) {
  Map map;
  gaussians::Gaussians& g = map.gaussians;
  g = gaussians::Gaussians::empty(0, torch::kFloat32);
  const std::int64_t n = points.size(0);
  g.means = points.to(torch::kFloat32).contiguous();
  g.log_scales = torch::full({n, 3}, static_cast<float>(std::log(1.2 * kSpacing)));
  g.quaternions = torch::tensor({1.0F, 0.0F, 0.0F, 0.0F}).expand({n, 4}).contiguous();
  g.logit_opacities = torch::full({n}, 1.0F);
  g.sh_dc = torch::zeros({n, 3});
  g.sh_rest = torch::zeros({n, 0, 3});
  return map;
}

/// Points of a grid in x and y, with depth as a function of both.
template <typename Depth>
Tensor lattice(double half_width, double top, double bottom, const Depth& depth) {
  const Tensor x = torch::arange(-half_width, half_width, kSpacing, torch::kFloat64);
  const Tensor y = torch::arange(top, bottom, kSpacing, torch::kFloat64);
  const std::vector<Tensor> grid = torch::meshgrid({y, x}, "ij");
  return torch::stack({grid[1], grid[0], depth(grid[1], grid[0])}, 2).reshape({-1, 3});
}

struct Depths {
  Tensor drawn;
  Tensor surface;
};

Depths depths_of(const Map& map) {
  const gaussians::View view = {
      .intrinsics = kCamera, .T_camera_world = torch::eye(4, torch::kFloat64), .pose_delta = {}};
  const gaussians::RenderOutput out = gaussians::render(map.gaussians, view, {.background = {}});
  return {.drawn = out.depth, .surface = surface_depth(map, view, out.depth, out.alpha)};
}

/// Crops the image border.
Tensor middle(const Tensor& image) {
  return image.slice(0, 15, -15).slice(1, 15, -15).to(torch::kFloat64);
}

TEST(SurfaceDepth, IsUnbiasedOnSlantedFloor) {
  // A floor that slopes toward the camera: depth z = 2 - 1.3 y.
  const Map map =
      map_of(lattice(3.0, -2.0, 1.2, [](const Tensor&, const Tensor& y) { return 2.0 - 1.3 * y; }));
  const Depths depths = depths_of(map);
  const Tensor v = (torch::arange(120, torch::kFloat64) + 0.5 - 60.0) / 105.0;
  const Tensor truth = (2.0 / (1.0 + 1.3 * v)).unsqueeze(1).expand({120, 160});
  const auto error = [&](const Tensor& depth) {
    return (middle(depth) / middle(truth) - 1.0).mean().item<double>();
  };
  EXPECT_LT(error(depths.drawn), -0.01);
  EXPECT_NEAR(error(depths.surface), 0.0, 0.002);
  const Tensor worst = (middle(depths.surface) / middle(truth) - 1.0).abs().max();
  EXPECT_LT(worst.item<double>(), 0.01);
}

TEST(SurfaceDepth, EqualsRenderedDepthOnFrontoParallelWall) {
  const Map map =
      map_of(lattice(2.0, -1.5, 1.5, [](const Tensor& x, const Tensor&) { return 2.0 + 0.0 * x; }));
  const Depths depths = depths_of(map);
  EXPECT_LT((middle(depths.surface) - 2.0).abs().max().item<double>(), 1e-3);
}

TEST(SurfaceDepth, ExtrapolationIsLimitedAtDepthEdge) {
  const Map map = map_of(lattice(3.0, -2.0, 2.0, [](const Tensor& x, const Tensor&) {
    return torch::where(x < 0.0, torch::full_like(x, 1.5), torch::full_like(x, 3.0));
  }));
  const Tensor surface = middle(depths_of(map).surface);
  EXPECT_GT(surface.min().item<double>(), 0.9 * 1.5);
  EXPECT_LT(surface.max().item<double>(), 1.1 * 3.0);
}

TEST(SurfaceDepth, IsZeroInEmptyPixels) {
  const Map map =
      map_of(lattice(0.3, -0.3, 0.3, [](const Tensor& x, const Tensor&) { return 2.0 + 0.0 * x; }));
  const Depths depths = depths_of(map);
  EXPECT_TRUE(torch::equal(depths.surface == 0.0, depths.drawn == 0.0));
  EXPECT_EQ(depths.surface[0][0].item<float>(), 0.0F);
  EXPECT_TRUE(torch::isfinite(depths.surface).all().item<bool>());
}

}  // namespace
}  // namespace apvi::mapping
