// SPDX-License-Identifier: BSD-3-Clause
#include "survey/survey_view.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <vector>

namespace apvi::survey {
namespace {

/// Looks along z from (x, 0, 0).
gaussians::View camera_at(double x) {
  gaussians::View view;
  view.intrinsics = {.fx = 120.0, .fy = 120.0, .cx = 80.0, .cy = 60.0, .width = 160, .height = 120};
  view.T_camera_world = torch::eye(4, torch::kFloat64);
  view.T_camera_world[0][3] = -x;
  return view;
}

torch::Tensor wall() {
  return torch::tensor({{-0.2, 0.0, 2.0}, {0.0, 0.1, 2.0}, {0.2, -0.1, 2.0}}, torch::kFloat64);
}

TEST(ComparisonViews, ParallaxOfSomeDegreesComesFirst) {
  const std::vector<gaussians::View> views = {camera_at(0.0), camera_at(0.02), camera_at(1.1),
                                              camera_at(0.35), camera_at(-0.4)};
  const auto chosen = comparison_views(views, 0, wall(), 3);
  EXPECT_EQ(chosen, (std::vector<std::size_t>{3, 4, 2}));
}

TEST(ComparisonViews, ViewsThatDoNotShowThePointsAreLeftOut) {
  std::vector<gaussians::View> views = {camera_at(0.0), camera_at(9.0), camera_at(0.3)};
  views.push_back(camera_at(0.3));
  views.back().T_camera_world[2][3] = -5.0;  // beyond the wall
  EXPECT_EQ(comparison_views(views, 0, wall(), 8), (std::vector<std::size_t>{2}));
  EXPECT_TRUE(comparison_views(views, 0, torch::zeros({0, 3}, torch::kFloat64), 8).empty());
}

}  // namespace
}  // namespace apvi::survey
