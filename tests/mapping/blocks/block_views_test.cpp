// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/blocks/block_views.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

gaussians::View view_at(double x, double y) {
  return {.intrinsics = test::small_camera(),
          .T_camera_world = test::camera_at(x, y),
          .pose_delta = {}};
}

TEST(SurfacePoints, LieOnTheSurfaceInTheImage) {
  Map map;
  map.gaussians = test::gaussian_wall(2000);
  const Tensor points = surface_points(map, view_at(0.3, -0.2));
  ASSERT_GT(points.size(0), 300);
  const Tensor x = points.select(1, 0);
  const Tensor depth = 3.0 + 0.3 * (2.0 * x).sin();
  // The Gaussians have a standard deviation of 0.12 m.
  EXPECT_LT((points.select(1, 2) - depth).abs().median().item<double>(), 0.12);
  // 48 px at a focal length of 40 px and a distance of about 3 m.
  EXPECT_NEAR(x.max().item<double>() - x.min().item<double>(), 3.6, 0.4);
  EXPECT_NEAR(x.mean().item<double>(), 0.3, 0.15);
}

TEST(SurfacePoints, AreNoneWhereTheMapIsEmpty) {
  Map map;
  map.gaussians = test::gaussian_wall(2000);
  map.gaussians.means.select(1, 2).mul_(-1.0);
  EXPECT_EQ(surface_points(map, view_at(0.0, 0.0)).size(0), 0);
}

TEST(BlockShares, AreFractionsOfThePoints) {
  const Tensor points = torch::tensor(
      {{0.0, 0.0, 0.0}, {1.0, 0.0, 0.0}, {2.0, 0.0, 0.0}, {9.0, 0.0, 0.0}}, torch::kFloat64);
  const BlockPartition halves({{.axis = 0, .value = 5.0, .below = -1, .above = -2}});
  const Tensor shares = block_shares(halves, points);
  EXPECT_TRUE(torch::equal(shares, torch::tensor({0.75, 0.25}, torch::kFloat64)));
  EXPECT_TRUE(torch::equal(block_shares(halves, points.slice(0, 0, 0)),
                           torch::zeros({2}, torch::kFloat64)));
}

TEST(NearAnyView, KeepsWhatTheImagesShowAndALittleMore) {
  // The image spans 3.6 m at a distance of 3 m, and 15 % of that on each side.
  const Tensor means = torch::tensor(
      {{0.0F, 0.0F, 3.0F}, {1.9F, 0.0F, 3.0F}, {3.0F, 0.0F, 3.0F}, {0.0F, 0.0F, -3.0F}});
  const Tensor near = near_any_view(means, {view_at(0.0, 0.0)});
  EXPECT_TRUE(torch::equal(near, torch::tensor({true, true, false, false})));
  const Tensor both = near_any_view(means, {view_at(0.0, 0.0), view_at(2.0, 0.0)});
  EXPECT_TRUE(torch::equal(both, torch::tensor({true, true, true, false})));
  EXPECT_FALSE(near_any_view(means, {}).any().item<bool>());
}

}  // namespace
}  // namespace apvi::mapping
