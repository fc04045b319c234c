// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "gaussians/device.hpp"
#include "mapping/training/map_optimizer.hpp"
#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

MapOptimizer with_limit(int max_gaussians) {
  TrainerOptions options;
  options.densify.max_gaussians = max_gaussians;
  return {test::gaussian_wall(400), options, 0};
}

TEST(MapOptimizerLimit, IsTheDefaultOfTheDeviceUnlessConfigured) {
  EXPECT_EQ(with_limit(0).max_gaussians(), gaussians::active_device().is_cuda() ? 600000 : 100000);
  EXPECT_EQ(with_limit(1000).max_gaussians(), 1000);
}

TEST(MapOptimizerLimit, LeavesRoomUntilItIsReached) {
  EXPECT_EQ(with_limit(1000).room(), 600);
  EXPECT_EQ(with_limit(300).room(), 0);
}

TEST(MapOptimizerLimit, DropsToTheNumberThatFitsIntoMemory) {
  MapOptimizer optimizer = with_limit(1000);
  optimizer.keep_most_important(250);
  EXPECT_EQ(optimizer.size(), 250);
  EXPECT_EQ(optimizer.max_gaussians(), 250);
  EXPECT_EQ(optimizer.room(), 0);
}

TEST(MapOptimizer, MediumCreatedWhileVioFailsLearnsFaster) {
  const KeyframeStore keyframes = test::render_keyframes(test::gaussian_wall());
  const medium::Medium water = {.beta_d = torch::tensor({0.2F, 0.1F, 0.1F}),
                                .beta_b = torch::tensor({0.2F, 0.1F, 0.1F}),
                                .b_inf = torch::tensor({0.1F, 0.3F, 0.3F})};
  const auto rate = [&](bool failing) {
    MapOptimizer optimizer(test::gaussian_wall(), {}, keyframes.size());
    optimizer.set_vio_failing(failing);
    optimizer.start_medium(water, keyframes);
    return *optimizer.medium_rate();
  };
  EXPECT_DOUBLE_EQ(rate(true), 2.0 * rate(false));
}

TEST(MapOptimizer, AnotherToneCurveHardlyChangesTheImages) {
  const KeyframeStore keyframes = test::render_keyframes(test::gaussian_wall());
  // Overlapping Gaussians of different colors blend differently in linear light.
  gaussians::Gaussians wall = test::gaussian_wall();
  wall.sh_dc = wall.means.sin();
  MapOptimizer optimizer(wall, {}, keyframes.size());
  const auto image = [&] {
    const Map map = optimizer.full_map();
    return map.tone_curve.encode(render_map(map, keyframes.view(0, 1)).color);
  };
  const torch::Tensor before = image();
  MediumEstimation estimation;
  estimation.views = keyframes.training();
  estimation.tone_curve = {.gamma = 2.2};
  estimation.fit.medium = {.beta_d = torch::full({3}, 0.1, torch::kFloat64),
                           .beta_b = torch::full({3}, 0.1, torch::kFloat64),
                           .b_inf = torch::full({3}, 0.05, torch::kFloat64)};
  estimation.fit.log_gains =
      torch::zeros({static_cast<std::int64_t>(estimation.views.size())}, torch::kFloat64);
  estimation.fit.resolution = torch::zeros({3, 3, 3}, torch::kFloat64);
  estimation.fit.sigmas = torch::ones({3, 3}, torch::kFloat64);
  optimizer.apply_medium(estimation, keyframes);
  EXPECT_EQ(optimizer.tone_curve(), estimation.tone_curve);
  const torch::Tensor solid = render_map(optimizer.full_map(), keyframes.view(0, 1)).alpha > 0.99;
  ASSERT_GT(solid.sum().item<std::int64_t>(), 100);
  const double change = (image() - before).index({solid}).abs().mean().item<double>();
  EXPECT_LT(change, 0.02);
}

}  // namespace
}  // namespace apvi::mapping
