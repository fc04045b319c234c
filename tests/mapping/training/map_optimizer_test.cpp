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

}  // namespace
}  // namespace apvi::mapping
