// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/random_insertion.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kCount = 2000;
constexpr double kExtent_m = 40.0;

struct Drawn {
  Tensor column;  ///< [n] of each new Gaussian in the image [px]
  Tensor depth;   ///< [n] [m]
};

/// Inserts Gaussians for the image of a wall at 2.7 to 3.3 m, of which the map contains `known`.
Drawn draw(const gaussians::Gaussians& known) {
  KeyframeStore keyframes;
  keyframes.add(test::render_keyframe(test::gaussian_wall(2000), test::camera_at(0.0, 0.0), 0));
  Map map;
  map.gaussians = known;
  Random random(5);
  const Tensor means =
      random_gaussians(map, keyframes, 0, kCount, kExtent_m, random).means.to(torch::kFloat64);
  const Tensor depth = means.select(1, 2);
  return {.column = 40.0 * means.select(1, 0) / depth + 24.0, .depth = depth};
}

double middle(const Tensor& values) {
  return values.median().item<double>();
}

TEST(RandomInsertion, UsesTheDepthOfTheMap) {
  const Drawn drawn = draw(test::gaussian_wall(2000));
  EXPECT_EQ(drawn.depth.size(0), kCount);
  EXPECT_GT(drawn.depth.min().item<double>(), 2.6);
  EXPECT_LT(drawn.depth.max().item<double>(), 3.4);
}

TEST(RandomInsertion, SamplesDepthsOfTheImageWhereTheMapIsEmpty) {
  gaussians::Gaussians left = test::gaussian_wall(2000);
  const Tensor there = left.means.select(1, 0) < 0;
  for (Tensor* const tensor : left.tensors()) *tensor = tensor->index({there}).contiguous();
  const Drawn drawn = draw(left);
  const Tensor unknown = drawn.depth.masked_select(drawn.column > 28.0);
  ASSERT_GT(unknown.numel(), 500);
  EXPECT_NEAR(middle(unknown), 3.0, 0.3);
  EXPECT_GT(unknown.std().item<double>(), 0.3);  // depth was unknown
  EXPECT_LT(unknown.max().item<double>(), 8.0);
  EXPECT_LT(middle(drawn.depth.masked_select(drawn.column < 20.0)), 3.3);
}

TEST(RandomInsertion, SamplesTheWholeRayWithoutAnyDepth) {
  const Drawn drawn = draw(gaussians::Gaussians::empty(0, torch::kFloat32));
  EXPECT_NEAR(middle(drawn.depth), 0.55 * kExtent_m, 0.05 * kExtent_m);
  EXPECT_GE(drawn.depth.min().item<double>(), 0.1 * kExtent_m - 1e-3);
  EXPECT_LE(drawn.depth.max().item<double>(), kExtent_m + 1e-3);
}

}  // namespace
}  // namespace apvi::mapping
