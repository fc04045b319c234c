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
    if (mapper.times().seconds("water") > passed_s) after.push_back(i + 1);
    passed_s = mapper.times().seconds("water");
  }
  return after;
}

TEST(MapperMedium, IsEstimatedAgainAfterFortyPercentMoreKeyframes) {
  EXPECT_EQ(estimations({}), (std::vector<int>{60, 84}));
}

// The camera's gain may have changed arbitrarily.
TEST(MapperMedium, IsEstimatedTwentyKeyframesAfterAnOutage) {
  EXPECT_EQ(estimations(60), (std::vector<int>{60, 81}));
}

}  // namespace
}  // namespace apvi::mapping
