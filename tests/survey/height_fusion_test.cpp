// SPDX-License-Identifier: BSD-3-Clause
#include "survey/height_fusion.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <limits>
#include <vector>

#include "survey/flat_ground.hpp"

namespace apvi::survey {
namespace {

using torch::Tensor;

/// Cameras at the origin's height, looking down and a little to the east.
std::vector<SurveyView> views_of(int count) {
  std::vector<SurveyView> views;
  for (int i = 0; i < count; ++i) {
    gaussians::View view;
    view.intrinsics = {
        .fx = 120.0, .fy = 120.0, .cx = 80.0, .cy = 60.0, .width = 160, .height = 120};
    view.T_camera_world = torch::tensor({{0.8, 0.0, 0.6, 0.08 * i},
                                         {0.0, -1.0, 0.0, 0.0},
                                         {0.6, 0.0, -0.8, 0.06 * i},
                                         {0.0, 0.0, 0.0, 1.0}},
                                        torch::kFloat64);
    views.push_back({view});
  }
  return views;
}

struct Ground {
  test::Plane plane{.side_m = 6.0, .spacing_m = 0.03, .height_m = -2.0, .slope = 0.2};
  SE3 T_crs_map{Eigen::Quaterniond::Identity(), {691234.5, 5331234.5, 10.0}};
  SurveyMap map = test::plane_map(plane, T_crs_map);
  GroundGrid grid = grid_around({691235.0, 5331234.0, 691236.0, 5331235.0}, 0.02);
  Tensor truth = heights();

  Tensor heights() const {
    const Tensor x = grid.west - 691234.5 + (torch::arange(50, torch::kFloat64) + 0.5) * 0.02;
    return (8.0 + 0.2 * x).expand({50, 50}).clone();
  }
};

TEST(HeightFusion, HeightsThatAreOffReturnToTheSurface) {
  const Ground ground;
  torch::manual_seed(5);
  const Tensor start = ground.truth + 0.1 * (torch::rand({50, 50}, torch::kFloat64) - 0.5);
  const Tensor heights = HeightFusion(ground.map, views_of(5))(start, ground.grid);
  EXPECT_LT((heights - ground.truth).square().mean().sqrt().item<double>(), 3e-3);
}

TEST(HeightFusion, UnknownPixelsStayUnknown) {
  const Ground ground;
  Tensor start = ground.truth.clone();
  start[3][4] = std::numeric_limits<double>::quiet_NaN();
  const Tensor heights = HeightFusion(ground.map, views_of(5))(start, ground.grid);
  EXPECT_EQ(heights.isnan().sum().item<std::int64_t>(), 1);
  EXPECT_TRUE(heights[3][4].isnan().item<bool>());
}

TEST(HeightFusion, WhereNoViewLooksNothingIsKnown) {
  const Ground ground;
  const GroundGrid far = grid_around({691200.0, 5331200.0, 691201.0, 5331201.0}, 0.02);
  const Tensor heights = HeightFusion(ground.map, views_of(5))(ground.truth, far);
  EXPECT_TRUE(heights.isnan().all().item<bool>());
}

TEST(HeightFusion, ViewsFromBelowDoNotCount) {
  Ground ground;
  const Tensor clear = HeightFusion(ground.map, views_of(5))(ground.truth, ground.grid);
  std::vector<SurveyView> views = views_of(5);
  for (int i = 0; i < 3; ++i) {
    views.push_back(views.front());
    gaussians::View& camera = views.back().camera;
    camera.T_camera_world = camera.T_camera_world.clone();
    camera.T_camera_world[2][3] = -6.0;
  }
  const Tensor heights = HeightFusion(ground.map, views)(ground.truth, ground.grid);
  EXPECT_LT((heights - clear).abs().max().item<double>(), 1e-4);
}

}  // namespace
}  // namespace apvi::survey
