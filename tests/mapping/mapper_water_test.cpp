// SPDX-License-Identifier: BSD-3-Clause
// When the mapper surveys the water.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <optional>
#include <vector>

#include "apvi/mapping/mapper.hpp"
#include "mapper_scene.hpp"
#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

constexpr int kOutage = 5;  // [s]

/// After how many of 90 keyframes, a second apart, the water is surveyed. An outage may come after
/// so many of them.
std::vector<int> surveys(const std::optional<int>& outage_after) {
  const splat::Gaussians world = test::wall_of_gaussians();
  MapperOptions options = small_map_options();
  options.medium = true;
  options.online.medium_after = 60;
  Mapper mapper(options);
  std::vector<int> after;
  double passed_s = 0.0;
  for (int i = 0; i < 90; ++i) {
    MapperInput input;
    const int second = outage_after && i >= *outage_after ? i + kOutage : i;
    input.keyframe = test::photograph(world, test::camera_at(0.015 * i - 0.7, 0.0), second);
    input.points = points_of(world);
    EXPECT_EQ(mapper.add(input), Intake::taken);
    if (mapper.times().of("water") > passed_s) after.push_back(i + 1);
    passed_s = mapper.times().of("water");
  }
  return after;
}

TEST(MapperWater, IsSurveyedAgainWhenThereAreFourTenthsMoreKeyframes) {
  EXPECT_EQ(surveys({}), (std::vector<int>{60, 84}));
}

// The camera's gain may have gone anywhere.
TEST(MapperWater, IsSurveyedTwentyKeyframesAfterAnOutage) {
  EXPECT_EQ(surveys(60), (std::vector<int>{60, 81}));
}

}  // namespace
}  // namespace apvi::mapping
