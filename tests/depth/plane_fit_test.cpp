// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <vector>

#include "depth/depth_backend.hpp"
#include "depth/quadtree.hpp"

namespace apvi::depth {
namespace {

constexpr int kSide = 8;
constexpr int kWidth = 48;
constexpr int kHeight = 40;

/// 1/depth over an image of 48 x 40 px in blocks of 8 px, as a function of a block's center (x, y)
/// [px].
template <typename Function>
PlaneFitInput grid(const Function& inverse_depth) {
  const std::vector<Block> blocks =
      build_quadtree(torch::zeros({kHeight, kWidth}), {.max_block_px = kSide});
  const BlockGraph graph = neighbor_graph(blocks, kWidth, kHeight);
  std::vector<float> points;
  std::vector<float> values;
  for (const Block& b : blocks) {
    const double x = b.x + 0.5 * b.width;
    const double y = b.y + 0.5 * b.height;
    points.insert(points.end(), {static_cast<float>(x), static_cast<float>(y)});
    values.push_back(static_cast<float>(inverse_depth(x, y)));
  }
  return {.inverse_depths = torch::tensor(values),
          .points = torch::tensor(points).reshape({-1, 2}),
          .offsets = torch::tensor(graph.offsets, torch::kInt32),
          .neighbors = torch::tensor(graph.neighbors, torch::kInt32),
          .max_relative_difference = 0.1,
          .max_slope = 0.02};
}

/// A block with neighbors on all sides.
constexpr int kInner = 2 * (kWidth / kSide) + 2;

TEST(FittedPlanes, SlopeMatchesPlane) {
  // 1/depth of a plane is linear in the image: 0.5 at the center (20, 20) of the inner block.
  const PlaneFitInput input =
      grid([](double x, double y) { return 0.5 * (1.0 + 0.004 * (x - 20) - 0.007 * (y - 20)); });
  const FittedPlanes out = cpu_depth_backend().fit_planes(input);
  // The prior of zero slope has a weight of 1/129.
  EXPECT_NEAR(out.slope[kInner][0].item<double>(), 0.004, 0.004 / 100);
  EXPECT_NEAR(out.slope[kInner][1].item<double>(), -0.007, 0.007 / 100);
  EXPECT_EQ(out.agreement[kInner].item<float>(), 1.0F);
}

TEST(FittedPlanes, ExcludesNeighborsAcrossDepthEdge) {
  const PlaneFitInput input = grid([](double x, double) { return x < 24 ? 0.5 : 0.3; });
  const FittedPlanes out = cpu_depth_backend().fit_planes(input);
  EXPECT_FLOAT_EQ(out.agreement[kInner].item<float>(), 0.75F);  // three of four
  EXPECT_FLOAT_EQ(out.agreement[kInner - 1].item<float>(), 1.0F);
  EXPECT_NEAR(out.slope[kInner].abs().max().item<double>(), 0.0, 1e-6);
}

TEST(FittedPlanes, SlopeIsLimited) {
  const PlaneFitInput input = grid([](double x, double) { return 0.5 * (1.0 + 0.01 * x); });
  PlaneFitInput gentle = input;
  gentle.max_slope = 0.001;
  const FittedPlanes out = cpu_depth_backend().fit_planes(gentle);
  EXPECT_FLOAT_EQ(out.slope.abs().max().item<float>(), 0.001F);
  EXPECT_GT(cpu_depth_backend().fit_planes(input).slope.max().item<float>(), 0.005F);
}

TEST(FittedPlanes, IsolatedBlockHasFullAgreementAndZeroSlope) {
  PlaneFitInput input = grid([](double, double) { return 0.5; });
  input.inverse_depths = torch::tensor({0.5F});
  input.points = torch::tensor({{4.0F, 4.0F}});
  input.offsets = torch::tensor({0, 0}, torch::kInt32);
  input.neighbors = torch::empty({0}, torch::kInt32);
  const FittedPlanes out = cpu_depth_backend().fit_planes(input);
  EXPECT_FLOAT_EQ(out.agreement[0].item<float>(), 1.0F);
  EXPECT_FLOAT_EQ(out.slope.abs().max().item<float>(), 0.0F);
}

}  // namespace
}  // namespace apvi::depth
