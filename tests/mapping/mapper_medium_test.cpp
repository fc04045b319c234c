// SPDX-License-Identifier: BSD-3-Clause
// Medium estimation in the mapper.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <optional>
#include <vector>

#include "mapping/mapper.hpp"
#include "mapping/mapper_scene.hpp"
#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr int kOutage = 5;  // [s]

/// Keyframe counts, out of 90 keyframes one second apart, at which the medium is estimated;
/// optionally with an outage after `outage_after` keyframes.
std::vector<int> estimations(const std::optional<int>& outage_after) {
  const gaussians::Gaussians world = test::gaussian_wall();
  MapperOptions options = small_map_options();
  options.medium = true;
  options.online.medium_min_keyframes = 60;
  Mapper mapper(options);
  std::vector<int> after;
  double passed_s = 0.0;
  for (int i = 0; i < 90; ++i) {
    MapperInput input;
    const int second = outage_after && i >= *outage_after ? i + kOutage : i;
    input.keyframe = test::render_keyframe(world, test::camera_at(0.015 * i - 0.7, 0.0), second);
    input.points = points_of(world);
    EXPECT_EQ(mapper.add(input), KeyframeDecision::accepted);
    if (mapper.times().seconds("medium") > passed_s) after.push_back(i + 1);
    passed_s = mapper.times().seconds("medium");
  }
  return after;
}

medium::Medium turbid_water() {
  return {.beta_d = torch::tensor({0.4F, 0.2F, 0.2F}),
          .beta_b = torch::tensor({0.4F, 0.2F, 0.2F}),
          .b_inf = torch::tensor({0.1F, 0.3F, 0.35F})};
}

/// The image of a keyframe with the medium in front of the world.
Tensor seen_in(const medium::Medium& water, const gaussians::Gaussians& world,
               const Keyframe& keyframe) {
  const gaussians::View view = {.intrinsics = keyframe.intrinsics,
                                .T_camera_world = keyframe.T_camera_world,
                                .pose_delta = {}};
  const Tensor color = render_map({.gaussians = world, .medium = water}, view).color;
  return (color.clamp(0.0, 1.0) * 255.0 + 0.5).to(torch::kUInt8);
}

TEST(MapperMedium, IsEstimatedAgainAfterFortyPercentMoreKeyframes) {
  EXPECT_EQ(estimations({}), (std::vector<int>{60, 84}));
}

// The camera's gain may have changed arbitrarily.
TEST(MapperMedium, IsEstimatedTwentyKeyframesAfterAnOutage) {
  EXPECT_EQ(estimations(60), (std::vector<int>{60, 81}));
}

/// A mapper with six keyframes of a wall in `water`, whose medium is optimized by gradient.
Mapper optimized_by_gradient(const medium::Medium& water) {
  const gaussians::Gaussians world = test::gaussian_wall();
  MapperOptions options = small_map_options();
  options.medium = true;
  options.trainer.medium_estimation = MediumEstimationMethod::gradient;
  Mapper mapper(options);
  for (int i = 0; i < 6; ++i) {
    MapperInput input;
    const Tensor pose = test::camera_at(0.1 * i - 0.3, 0.0);
    input.keyframe = test::render_keyframe(world, pose, i);
    input.keyframe.image = seen_in(water, world, input.keyframe);
    input.points = points_of(world);
    EXPECT_EQ(mapper.add(input), KeyframeDecision::accepted);
    EXPECT_EQ(mapper.map().medium.has_value(), i >= 4) << i;
  }
  return mapper;
}

TEST(MapperMedium, IsOptimizedByGradientFromTheFifthKeyframeOn) {
  Mapper mapper = optimized_by_gradient(turbid_water());
  const medium::Medium before = *mapper.map().medium;
  double first = 0.0;
  for (int k = 0; k < 200; ++k) {
    const double loss = mapper.step();
    if (k == 20) first = loss;
  }
  EXPECT_LT(mapper.step(), first);
  EXPECT_GT((mapper.map().medium->b_inf - before.b_inf).abs().max().item<double>(), 1e-3);
}

TEST(MapperMedium, LearningRateDoublesWhileVioFails) {
  Mapper mapper = optimized_by_gradient(turbid_water());
  const double usual = *mapper.optimizer().medium_rate();
  EXPECT_DOUBLE_EQ(usual, 1e-2);
  MapperInput failure;
  failure.vio_failing = true;
  mapper.add(failure);
  EXPECT_DOUBLE_EQ(*mapper.optimizer().medium_rate(), 2.0 * usual);
}

}  // namespace
}  // namespace apvi::mapping
