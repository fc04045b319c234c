// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/depth_seeder.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr int kBlock = 4;  // [px]

/// Blocks that cover an image of the small camera, all with the same confident depth.
depth::DepthEstimate flat_depth() {
  const gaussians::Intrinsics camera = test::small_camera();
  depth::DepthEstimate estimate;
  std::vector<float> points;
  for (int y = 0; y < camera.height; y += kBlock) {
    for (int x = 0; x < camera.width; x += kBlock) {
      estimate.blocks.push_back({x, y, kBlock, kBlock, kBlock});
      points.push_back(static_cast<float>(x) + 0.5F * kBlock);
      points.push_back(static_cast<float>(y) + 0.5F * kBlock);
    }
  }
  const auto count = static_cast<std::int64_t>(estimate.blocks.size());
  estimate.points = torch::tensor(points).view({count, 2});
  estimate.depth = torch::full({count}, 3.0F);
  estimate.confident = torch::ones({count}, torch::kBool);
  return estimate;
}

/// Seeds within an area that only the last view shows in another color. The map shows the others.
std::int64_t seeds_on_a_passing_body(bool robust) {
  const gaussians::Gaussians wall = test::gaussian_wall();
  KeyframeStore keyframes = test::render_keyframes(wall);
  Keyframe last = test::render_keyframe(wall, test::camera_at(0.1, 0.1), 9);
  last.image.narrow(0, 8, 12).narrow(1, 16, 16) =
      255 - last.image.narrow(0, 8, 12).narrow(1, 16, 16);
  keyframes.add(last);
  MapperOptions options;
  options.trainer.robust_weights = robust;
  MapOptimizer optimizer(wall, options.trainer, keyframes.size());
  optimizer.step(keyframes, 0, {});
  const Seeds seeds = DepthSeeder(options).seeds(flat_depth(), keyframes.size() - 1, keyframes,
                                                 optimizer, torch::empty({0, 3}, torch::kFloat64));
  const Tensor x = seeds.pixels.select(1, 0);
  const Tensor y = seeds.pixels.select(1, 1);
  return ((x > 16) & (x < 32) & (y > 8) & (y < 20)).sum().item<std::int64_t>();
}

TEST(DepthSeeder, RobustWeightsKeepSeedsOffWhatMoves) {
  EXPECT_EQ(seeds_on_a_passing_body(false), 12);
  EXPECT_EQ(seeds_on_a_passing_body(true), 0);
}

TEST(DepthSeeder, WhatTheMaskHidesGetsNoSeeds) {
  const gaussians::Gaussians wall = test::gaussian_wall();
  KeyframeStore keyframes;
  const Tensor scene = torch::ones({32, 48}, torch::kBool);
  scene.slice(1, 0, 24).fill_(false);
  keyframes.set_mask(scene);
  keyframes.add(test::render_keyframe(wall, test::camera_at(0.1, 0.1), 0));
  const MapperOptions options;
  MapOptimizer nothing(gaussians::Gaussians::empty(0, torch::kFloat32), options.trainer, 1);
  const Seeds seeds = DepthSeeder(options).seeds(flat_depth(), 0, keyframes, nothing,
                                                 torch::empty({0, 3}, torch::kFloat64));
  EXPECT_EQ(seeds.size(), 6 * 8);
  EXPECT_GT(seeds.pixels.select(1, 0).min().item<double>(), 24.0);
}

}  // namespace
}  // namespace apvi::mapping
