// SPDX-License-Identifier: BSD-3-Clause
#include "survey/vertical_renderer.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <numbers>

#include "gaussians/render/render.hpp"
#include "survey/flat_ground.hpp"

namespace apvi::survey {
namespace {

using torch::Tensor;

GroundGrid grid_of(double half_m, double resolution_m) {
  return grid_around({-half_m, -half_m, half_m, half_m}, resolution_m);
}

/// Heights of a plane at the pixel centers.
Tensor plane_heights(const GroundGrid& grid, const test::Plane& plane) {
  const Tensor x =
      grid.west + (torch::arange(grid.width, torch::kFloat64) + 0.5) * grid.resolution_m;
  return (plane.height_m + plane.slope * x).expand({grid.height, grid.width});
}

double rmse(const Tensor& error) {
  return error.square().mean().sqrt().item<double>();
}

TEST(VerticalRenderer, HeightsOfALevelPlaneAreItsHeight) {
  const test::Plane plane;
  const GroundGrid grid = grid_of(0.9, 0.01);
  const GroundImage image = VerticalRenderer(test::plane_map(plane)).render(grid);
  ASSERT_TRUE(image.known.all().item<bool>());
  EXPECT_LT(rmse(image.elevation - plane_heights(grid, plane)), 1e-5);
}

TEST(VerticalRenderer, HeightsOfASlopeAreRightToAMillimeter) {
  const test::Plane plane{.slope = 0.5};
  const GroundGrid grid = grid_of(0.9, 0.01);
  const GroundImage image = VerticalRenderer(test::plane_map(plane)).render(grid);
  EXPECT_LT(rmse(image.elevation - plane_heights(grid, plane)), 1e-3);
}

TEST(VerticalRenderer, BordersOfColorsLieWhereTheyAreOnTheGround) {
  const GroundGrid grid = grid_of(0.9, 0.01);
  const GroundImage image = VerticalRenderer(test::plane_map({.spacing_m = 0.01})).render(grid);
  // Red begins east of the middle, green north of it; rows go south.
  const Tensor red = image.color.select(2, 0) > 0.5;
  const Tensor green = image.color.select(2, 1) > 0.5;
  const double middle = 0.5 * static_cast<double>(grid.width);
  const Tensor first_red = red.to(torch::kInt64).argmax(1).to(torch::kFloat64);
  const Tensor green_rows = green.sum(0).to(torch::kFloat64);
  EXPECT_LE((first_red - middle).abs().max().item<double>(), 1.0);
  EXPECT_LE((green_rows - middle).abs().max().item<double>(), 1.0);
  EXPECT_TRUE(green[0].all().item<bool>());
}

TEST(VerticalRenderer, TilesMeetWithoutASeam) {
  const SurveyMap map = test::plane_map({.slope = 0.3});
  const GroundGrid whole = grid_of(0.9, 0.01);
  const VerticalRenderer renderer(map);
  const GroundImage at_once = renderer.render(whole);
  for (const GroundTile& tile : tiles_of(whole, 70)) {
    const GroundImage part = renderer.render(tile.grid);
    const auto window = [&](const Tensor& image) {
      return image.slice(0, tile.row, tile.row + tile.grid.height)
          .slice(1, tile.column, tile.column + tile.grid.width);
    };
    EXPECT_LT((part.elevation - window(at_once.elevation)).abs().max().item<double>(), 2e-4);
    EXPECT_LT((part.color - window(at_once.color)).abs().max().item<double>(), 0.02);
  }
}

TEST(VerticalRenderer, ReliefDoesNotDisplaceTheImage) {
  // A single Gaussian far from the middle of the tile and 20 m above another one.
  SurveyMap map = test::plane_map({.side_m = 0.2, .spacing_m = 0.1, .height_m = 0.0});
  map.map.gaussians.means = torch::tensor(
      {{3.005F, 2.005F, 20.0F}, {-3.005F, -2.005F, 0.0F}, {0.0F, 0.0F, 0.0F}, {1.0F, 0.0F, 5.0F}});
  const GroundGrid grid = grid_of(4.0, 0.01);
  const GroundImage image = VerticalRenderer(map).render(grid);
  const Tensor high = (image.elevation > 19.0).nonzero().to(torch::kFloat64) + 0.5;
  EXPECT_NEAR(high.select(1, 0).mean().item<double>(), (4.0 - 2.005) / 0.01, 0.05);
  EXPECT_NEAR(high.select(1, 1).mean().item<double>(), (4.0 + 3.005) / 0.01, 0.05);
}

TEST(VerticalRenderer, EqualsAPinholeCameraThatIsVeryFarAway) {
  torch::manual_seed(3);
  const std::int64_t n = 60;
  SurveyMap map;
  const Tensor means = torch::rand({n, 3}) - 0.5;
  map.map.gaussians = {.means = means,
                       .log_scales = torch::rand({n, 3}) - 3.5,
                       .quaternions = torch::randn({n, 4}),
                       .logit_opacities = torch::randn({n}) + 1.0,
                       .sh_dc = torch::randn({n, 3}),
                       .sh_rest = 0.2 * torch::randn({n, 15, 3})};
  const GroundGrid grid = grid_of(0.6, 0.01);
  const double far_m = 2000.0;
  gaussians::View view;
  view.intrinsics = {
      .fx = far_m / 0.01, .fy = far_m / 0.01, .cx = 60.0, .cy = 60.0, .width = 120, .height = 120};
  view.T_camera_world = torch::tensor(
      {{1.0, 0.0, 0.0, 0.0}, {0.0, -1.0, 0.0, 0.0}, {0.0, 0.0, -1.0, far_m}, {0.0, 0.0, 0.0, 1.0}},
      torch::kFloat64);
  // float64, since float32 has steps of 0.1 mm at that distance
  gaussians::Gaussians exact = map.map.gaussians;
  for (Tensor* tensor : exact.tensors()) *tensor = tensor->to(torch::kFloat64);
  const torch::NoGradGuard no_grad;
  const gaussians::RenderOutput truth = gaussians::render(exact, view, {});
  const VerticalView seen = VerticalRenderer(map).pinhole(grid);
  const gaussians::RenderOutput drawn = gaussians::render(seen.map.gaussians, seen.view, {});
  EXPECT_LT((drawn.alpha - truth.alpha).abs().max().item<double>(), 5e-3);
  EXPECT_LT((drawn.color - truth.color).abs().max().item<double>(), 1e-2);
  const Tensor height = seen.height(drawn.depth.to(torch::kFloat64));
  const Tensor known = truth.alpha > 0.5;
  const Tensor error = (height - (far_m - truth.depth)).index({known});
  EXPECT_LT(error.abs().max().item<double>(), 5e-3);
}

TEST(VerticalRenderer, NothingIsKnownWhereNoGaussianIs) {
  const SurveyMap map = test::plane_map({});
  const GroundImage image =
      VerticalRenderer(map).render(grid_around({10.0, 10.0, 11.0, 11.0}, 0.02));
  EXPECT_FALSE(image.known.any().item<bool>());
  EXPECT_TRUE(image.elevation.isnan().all().item<bool>());
}

TEST(VerticalRenderer, UtmCoordinatesKeepMillimeters) {
  const test::Plane plane{.slope = 0.5};  // 1 mm to the east is 0.5 mm of height
  const SE3 place{Eigen::Quaterniond::Identity(), {691234.567, 5331234.567, 1.25}};
  const double x = place.translation.x();
  const double y = place.translation.y();
  const GroundGrid grid = grid_around({x - 0.5, y - 0.5, x + 0.5, y + 0.5}, 0.01);
  const GroundImage image = VerticalRenderer(test::plane_map(plane, place)).render(grid);
  const Tensor east = (torch::arange(grid.width, torch::kFloat64) + 0.5) * 0.01 + (grid.west - x);
  const Tensor truth = (plane.height_m + 1.25 + 0.5 * east).expand({grid.height, grid.width});
  EXPECT_LT(rmse(image.elevation - truth), 1e-3);
}

}  // namespace
}  // namespace apvi::survey
