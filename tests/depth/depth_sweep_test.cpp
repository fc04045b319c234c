// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <vector>

#include "depth/depth_backend.hpp"
#include "depth/depth_scene.hpp"

namespace apvi::depth {
namespace {

using test::camera_at;
using test::look;
using test::Plane;
using torch::Tensor;

constexpr Plane kWall = {{0.0, 0.0, 1.0}, 2.0};
constexpr int kHypotheses = 61;

/// Cameras in a row that all look straight ahead, the first at 0.
struct Row {
  std::vector<Tensor> grays;
  SweepInput input;

  explicit Row(const std::vector<double>& places) {
    std::vector<Tensor> projections;
    std::vector<Tensor> centers;
    const gaussians::Intrinsics k = test::small_camera();
    for (const double x : places) {
      grays.push_back(look(kWall, camera_at(x, 0.0, 0.0)).gray);
      if (grays.size() == 1) continue;
      Tensor P = torch::eye(3, 4);
      P[0][3] = -k.fx * x;
      projections.push_back(P);
      centers.push_back(torch::tensor({x, 0.0, 0.0}).to(torch::kFloat32));
    }
    const double f = 1.0 / k.fx;
    input = {.projections = torch::stack(projections),
             .points = torch::tensor({{80.0F, 60.0F}, {44.0F, 90.0F}, {3.0F, 3.0F}}),
             .levels = torch::zeros({3}, torch::kInt32),
             .inverse_depths = torch::linspace(1.0, 0.2, kHypotheses).unsqueeze(0),
             .slopes = torch::zeros({3, 2}),
             .rays = torch::tensor({f, 0.0, -f * k.cx, 0.0, f, -f * k.cy, 0.0, 0.0, 1.0})
                         .to(torch::kFloat32)
                         .reshape({3, 3}),
             .centers = torch::stack(centers),
             .cost = PhotometricCost::zncc,
             .noise = 2.0 / 255.0,
             .medium = {}};
  }

  SweepOutput sweep() const {
    const DepthBackend& backend = cpu_depth_backend();
    return backend.sweep(backend.prepare(grays), input);
  }
};

/// The hypothesis closest to the wall, at 1/2 [1/m].
int wall_index(const Row& row) {
  return (row.input.inverse_depths - 0.5).abs().argmin().item<int>();
}

TEST(DepthSweep, CostIsMinimalAtTrueDepth) {
  const Row row({0.0, 0.1, -0.1, 0.2});
  const Tensor cost = row.sweep().cost;
  for (const int point : {0, 1}) {
    EXPECT_NEAR(cost[point].argmin().item<int>(), wall_index(row), 1);
    EXPECT_LT(cost[point].min().item<float>(), 0.05F);
  }
}

TEST(DepthSweep, EveryImageHasEqualWeight) {
  const Row row({0.0, 0.1, -0.1, 0.15, -0.15});
  EXPECT_TRUE((row.sweep().views[0] == 4).all().item<bool>());
  for (std::size_t v = 1; v < row.grays.size(); ++v) {  // and none is skipped
    Row changed = row;
    changed.grays[v] = 1.0 - row.grays[v];
    const Tensor difference = changed.sweep().cost[0] - row.sweep().cost[0];
    EXPECT_NEAR(difference[wall_index(row)].item<float>(), 0.25F, 0.03F) << "view " << v;
  }
}

TEST(DepthSweep, AveragesBestMatchingViews) {
  Row row({0.0, 0.05, -0.05, 0.1, -0.1, 0.15, -0.15, 0.2, -0.2});
  const int wall = wall_index(row);
  for (const std::size_t v : {1, 3, 5, 7}) row.grays[v] = 1.0 - row.grays[v];  // occluded
  EXPECT_GT(row.sweep().cost[0][wall].item<float>(), 0.4F);
  row.input.best_share = 0.5;
  EXPECT_LT(row.sweep().cost[0][wall].item<float>(), 0.05F);
  EXPECT_EQ(row.sweep().views[0][wall].item<int>(), 8);
}

TEST(DepthSweep, AveragesAllOfFewViews) {
  EXPECT_EQ(best_view_count(0, 0.5), 0);
  EXPECT_EQ(best_view_count(2, 0.1), 2);
  EXPECT_EQ(best_view_count(7, 0.5), 4);
  EXPECT_EQ(best_view_count(9, 0.5), 5);
  EXPECT_EQ(best_view_count(31, 1.0), 31);
}

TEST(DepthSweep, IsInvariantToGainAndOffsetOfView) {
  Row row({0.0, 0.1, -0.1, 0.2});
  row.input.noise = 0.0;
  const Tensor before = row.sweep().cost;
  row.grays[2] = 0.5 * row.grays[2] + 0.3;
  EXPECT_LT((row.sweep().cost - before).abs().max().item<float>(), 2e-3F);
}

TEST(DepthSweep, UnobservedHypothesisGetsMeanCost) {
  const Row row({0.0, 0.4});  // near points of the corner are outside the other image
  const SweepOutput out = row.sweep();
  const Tensor seen = out.views[2] > 0;
  ASSERT_FALSE(seen.any().item<bool>());
  const Tensor partly = out.views[1] > 0;
  ASSERT_TRUE(partly.any().item<bool>());
  ASSERT_FALSE(partly.all().item<bool>());
  const float mean = out.cost[1].masked_select(partly).mean().item<float>();
  const Tensor others = out.cost[1].masked_select(~partly);
  EXPECT_LT((others - mean).abs().max().item<float>(), 1e-5F);
  EXPECT_LE(out.cost.max().item<float>(), 1.0F);
  EXPECT_GE(out.cost.min().item<float>(), 0.0F);
}

TEST(DepthSweep, UniformPatchesHaveUniformCost) {
  Row row({0.0, 0.1, -0.1});
  torch::manual_seed(1);
  for (Tensor& gray : row.grays) {
    gray = 0.5 + 0.3 / 255.0 * torch::randn(gray.sizes()).clamp(-3.0, 3.0);
  }
  const Tensor cost = row.sweep().cost;
  EXPECT_GT(cost[0].min().item<float>(), 0.9F);
}

TEST(DepthSweep, CoarseHypothesesDoNotMissMinimum) {
  Row row({0.0, 0.2, -0.2, 0.3});
  row.input.inverse_depths = torch::linspace(4.0, 0.05, 18).unsqueeze(0);  // 0.23 1/m: 11 px
  for (const float offset : {0.0F, 0.06F, 0.12F, 0.18F}) {
    Row shifted = row;
    shifted.input.inverse_depths = row.input.inverse_depths + offset;
    const Tensor w = shifted.input.inverse_depths[0];
    const int best = shifted.sweep().cost[0].argmin().item<int>();
    EXPECT_LE(std::abs(w[best].item<float>() - 0.5F), 0.24F) << offset;
  }
}

}  // namespace
}  // namespace apvi::depth
