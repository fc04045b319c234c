// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/map_union.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "gaussians/model/point_cloud.hpp"
#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using test::bitwise_equal;
using torch::Tensor;

/// A wall without holes, in colors from 0.2 to 0.6.
gaussians::Gaussians solid_wall() {
  gaussians::Gaussians wall = test::gaussian_wall(4000);
  wall.sh_dc = gaussians::color_to_sh_dc(0.2 + 0.4 * torch::rand({wall.size(), 3}));
  return wall;
}

gaussians::Gaussians select(const gaussians::Gaussians& map, const Tensor& which) {
  gaussians::Gaussians out;
  for (std::size_t i = 0; i < map.tensors().size(); ++i) {
    *out.tensors()[i] = map.tensors()[i]->index({which}).contiguous();
  }
  return out;
}

gaussians::Gaussians in_light(gaussians::Gaussians map, const Tensor& light) {
  map.sh_dc = gaussians::color_to_sh_dc(gaussians::sh_dc_to_color(map.sh_dc) * light);
  return map;
}

std::vector<gaussians::View> views() {
  const KeyframeStore keyframes = test::render_keyframes(test::gaussian_wall());
  std::vector<gaussians::View> all;
  for (std::size_t i = 0; i < keyframes.size(); ++i) all.push_back(keyframes.view(i, 1));
  return all;
}

TEST(Unite, AddsNothingOfTheSameMap) {
  const gaussians::Gaussians wall = solid_wall();
  const MapUnion both = unite(wall, wall, views());
  EXPECT_EQ(both.added, 0);
  EXPECT_TRUE(bitwise_equal(both.gaussians, wall));
  EXPECT_TRUE(torch::allclose(both.light, torch::ones({3}), 0.0, 1e-5));
}

TEST(Unite, FillsTheGapsOfTheFirstMap) {
  const gaussians::Gaussians wall = solid_wall();
  const Tensor x = wall.means.select(1, 0);
  const Tensor y = wall.means.select(1, 1);
  const gaussians::Gaussians half = select(wall, x < 0.0);
  const MapUnion both = unite(half, wall, views());
  const Tensor added_x = both.gaussians.means.slice(0, half.size()).select(1, 0);
  // The cameras see at least |x| < 1.3, |y| < 0.8.
  const std::int64_t missing = ((x > 0.3) & (x < 1.3) & (y.abs() < 0.8)).sum().item<std::int64_t>();
  const std::int64_t filled = ((added_x > 0.3) & (added_x < 1.3)).sum().item<std::int64_t>();
  EXPECT_GE(filled, missing);
  EXPECT_GT(added_x.min().item<double>(), -0.2);
  EXPECT_EQ(both.gaussians.size(), half.size() + both.added);
}

TEST(Unite, AddsAnObjectInFrontOfTheFirstMap) {
  const gaussians::Gaussians wall = solid_wall();
  gaussians::Gaussians object = select(wall, wall.means.slice(1, 0, 2).norm(2, 1) < 0.2);
  object.means.select(1, 2) -= 1.0;
  gaussians::Gaussians with_object;
  for (std::size_t i = 0; i < wall.tensors().size(); ++i) {
    *with_object.tensors()[i] = torch::cat({*wall.tensors()[i], *object.tensors()[i]});
  }
  const MapUnion both = unite(wall, with_object, views());
  const Tensor added = both.gaussians.means.slice(0, wall.size());
  EXPECT_GT(added.size(0), object.size() * 3 / 4);
  EXPECT_LT(added.select(1, 2).max().item<double>(), 2.6);  // nothing of the wall
}

TEST(Unite, GivesAddedGaussiansTheColorsOfTheFirstMap) {
  const gaussians::Gaussians wall = solid_wall();
  const Tensor light = torch::tensor({1.5F, 0.5F, 0.25F});
  const gaussians::Gaussians half = select(wall, wall.means.select(1, 0) < 0.0);
  const MapUnion both = unite(half, in_light(wall, light), views());
  EXPECT_TRUE(torch::allclose(both.light, light, 0.03)) << both.light;
  const Tensor colors = gaussians::sh_dc_to_color(both.gaussians.sh_dc.slice(0, half.size()));
  EXPECT_NEAR(colors.mean().item<double>(), 0.4, 0.03);
}

TEST(Unite, MapsWithoutACommonSurfaceHaveTheSameLight) {
  gaussians::Gaussians far = solid_wall();
  far.means.select(1, 0) += 100.0;
  const MapUnion both = unite(far, solid_wall(), views());
  EXPECT_TRUE(torch::equal(both.light, torch::ones({3})));
  EXPECT_GT(both.added, 0);
}

TEST(Unite, HasTheHigherDegreeOfBothMaps) {
  const gaussians::Gaussians wall = solid_wall();
  gaussians::Gaussians other = wall;
  other.sh_rest = torch::zeros({wall.size(), gaussians::sh_rest_count(2), 3});
  EXPECT_EQ(unite(wall, other, views()).gaussians.sh_degree(), 2);
  EXPECT_EQ(unite(other, wall, views()).gaussians.sh_degree(), 2);
}

}  // namespace
}  // namespace apvi::mapping
