// SPDX-License-Identifier: BSD-3-Clause
#include "runs/views/map_section.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "runs/views/map_painter.hpp"

namespace apvi::runs {
namespace {

// Opaque balls of 5 cm at the heights 0, 1, ..., 4 m, on a diagonal.
mapping::Map staircase() {
  mapping::Map map;
  gaussians::Gaussians& g = map.gaussians;
  const auto steps = torch::arange(5, torch::kFloat32);
  g.means = torch::stack({0.3 * steps, torch::zeros(5), steps}, 1);
  g.log_scales = torch::full({5, 3}, std::log(0.05));
  g.quaternions = torch::tensor({{1.0F, 0.0F, 0.0F, 0.0F}}).repeat({5, 1});
  g.logit_opacities = torch::full({5}, 6.0);
  g.sh_dc = torch::full({5, 3}, 1.0);
  g.sh_rest = torch::zeros({5, 0, 3});
  return map;
}

viewer::Section slab(const Eigen::Vector3d& normal, double offset_m, double thickness_m) {
  return {.normal = normal, .offset_m = offset_m, .thickness_m = thickness_m};
}

// Toward +z, from 2 m below, with the ball of height `step` in the middle.
viewer::Viewpoint below(int step) {
  viewer::Viewpoint v{.width = 64, .height = 48, .focal = 1.0};
  v.T_world_camera.translation = {0.3 * step, 0.0, -2.0};
  return v;
}

TEST(MapSection, KeepsTheGaussiansBetweenItsPlanes) {
  const mapping::Map map = staircase();
  const mapping::Map level = cut(map, slab(Eigen::Vector3d::UnitZ(), 2.0, 2.2));
  ASSERT_EQ(level.gaussians.size(), 3);
  EXPECT_EQ(level.gaussians.means[0][2].item<double>(), 1.0);
  EXPECT_EQ(level.gaussians.means[2][2].item<double>(), 3.0);
  const Eigen::Vector3d tilted(0.6, 0.0, 0.8);  // 0.98 m from step to step
  EXPECT_EQ(cut(map, slab(tilted, 0.98, 0.1)).gaussians.size(), 1);
  EXPECT_EQ(cut(map, slab(-tilted, -0.98, 0.1)).gaussians.size(), 1);
  EXPECT_EQ(cut(map, slab(tilted, 40.0, 0.1)).gaussians.size(), 0);
}

TEST(MapSection, WithoutASectionItIsTheMapItself) {
  const mapping::Map map = staircase();
  MapSection section;
  EXPECT_EQ(&section.of(map, std::nullopt), &map);
  EXPECT_EQ(section.of(map, slab(Eigen::Vector3d::UnitZ(), 0.0, 1.0)).gaussians.size(), 1);
  EXPECT_EQ(section.of(map, slab(Eigen::Vector3d::UnitZ(), 0.5, 1.2)).gaussians.size(), 2);
}

TEST(MapSection, IsOfTheNewestMap) {
  MapPainter painter;
  painter.set_map(staircase(), {}, /*with_levels=*/false);
  viewer::Viewpoint view = below(2);
  view.section = slab(Eigen::Vector3d::UnitZ(), 2.0, 0.5);
  const auto depth = painter.depth(view, 32, 24);
  ASSERT_TRUE(depth);
  EXPECT_NEAR(*depth, 4.0, 0.1);
  mapping::Map higher = staircase();
  higher.gaussians.means.select(1, 2).add_(0.2);
  painter.set_map(higher, {}, /*with_levels=*/false);
  EXPECT_NEAR(painter.depth(view, 32, 24).value_or(0.0), 4.2, 0.1);
}

TEST(MapSection, OnlyWhatItHoldsIsDrawnAndMeasured) {
  MapPainter painter;
  painter.set_map(staircase(), {}, /*with_levels=*/false);
  viewer::View view{.viewpoint = below(0), .layer = viewer::Layer::depth};
  EXPECT_NEAR(painter.depth(view.viewpoint, 32, 24).value_or(0.0), 2.0, 0.1);
  view.viewpoint.section = slab(Eigen::Vector3d::UnitZ(), 3.0, 0.5);
  EXPECT_FALSE(painter.depth(view.viewpoint, 32, 24));
  EXPECT_LT(painter.render(view)->alpha.at<float>(24, 32), 0.01F);
}

TEST(MapSection, WithoutGaussiansIsEmptyNotAbsent) {
  MapPainter painter;
  painter.set_map(staircase(), {}, /*with_levels=*/false);
  viewer::View view{.viewpoint = below(0)};
  view.viewpoint.section = slab(Eigen::Vector3d::UnitZ(), 50.0, 0.5);
  const auto rendering = painter.render(view);
  ASSERT_TRUE(rendering);
  EXPECT_EQ(rendering->color.cols, 64);
  EXPECT_EQ(cv::countNonZero(rendering->alpha), 0);
  EXPECT_FALSE(painter.depth(view.viewpoint, 32, 24));
}

}  // namespace
}  // namespace apvi::runs
