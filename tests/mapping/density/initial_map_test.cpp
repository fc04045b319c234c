// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/initial_map.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using test::tensors_near;
using torch::Tensor;

TEST(InitialMap, NeighborDistanceMatchesBruteForce) {
  torch::manual_seed(4);
  const Tensor points = torch::randn({500, 3});
  Tensor squared = torch::cdist(points, points).square();
  squared.fill_diagonal_(1e9);
  const Tensor expected = std::get<0>(squared.topk(3, 1, /*largest=*/false)).mean(1).sqrt();
  EXPECT_TRUE(tensors_near(neighbor_distance(points), expected, 1e-4));
}

TEST(InitialMap, NeighborDistanceOfCoincidentPointsIsZero) {
  EXPECT_TRUE(torch::equal(neighbor_distance(torch::ones({5, 3})), torch::zeros({5})));
  EXPECT_TRUE(torch::equal(neighbor_distance(torch::ones({1, 3})), torch::zeros({1})));
  EXPECT_EQ(neighbor_distance(torch::ones({0, 3})).size(0), 0);
}

TEST(InitialMap, GaussiansHavePositionsAndColorsOfThePoints) {
  const gaussians::PointCloud points = {
      .positions = torch::tensor({{0.0F, 0.0F, 0.0F}, {0.2F, 0.0F, 0.0F}, {0.0F, 5.0F, 0.0F}}),
      .colors = torch::rand({3, 3})};
  const gaussians::Gaussians map =
      initial_map(points, {.sh_degree = 2, .opacity = 0.25, .max_scale_m = 1.0});
  EXPECT_TRUE(torch::equal(map.means, points.positions));
  EXPECT_TRUE(tensors_near(gaussians::sh_dc_to_color(map.sh_dc), points.colors, 1e-6));
  EXPECT_TRUE(tensors_near(map.logit_opacities.sigmoid(), torch::full({3}, 0.25F), 1e-6));
  EXPECT_EQ(map.sh_rest.sizes(), at::IntArrayRef({3, 8, 3}));
  EXPECT_FLOAT_EQ(map.log_scales[2][0].item<float>(), 0.0F);  // isolated: max_scale_m
}

TEST(InitialMap, RandomPointsAreUniformAndDeterministic) {
  const Box box = {.low = {-1.0, 2.0, 3.0}, .high = {1.0, 2.5, 7.0}};
  const gaussians::PointCloud points = random_points(box, 20000, 7);
  EXPECT_TRUE(torch::equal(points.positions, random_points(box, 20000, 7).positions));
  EXPECT_FALSE(torch::equal(points.positions, random_points(box, 20000, 8).positions));
  const Tensor low = torch::tensor({-1.0F, 2.0F, 3.0F});
  const Tensor high = torch::tensor({1.0F, 2.5F, 7.0F});
  EXPECT_TRUE(((points.positions >= low) & (points.positions <= high)).all().item<bool>());
  EXPECT_TRUE(tensors_near(points.positions.mean(0), 0.5 * (low + high), 0.02));
}

}  // namespace
}  // namespace apvi::mapping
