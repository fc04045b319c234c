// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/range_bias.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <cstddef>
#include <numeric>
#include <vector>

#include "mapping/medium/sea_bed.hpp"

namespace apvi::mapping {
namespace {

std::vector<std::size_t> all_of(const KeyframeStore& keyframes) {
  std::vector<std::size_t> all(keyframes.size());
  std::iota(all.begin(), all.end(), 0);
  return all;
}

// With the camera's true response.
Map bed_in(const medium::Medium& water, const KeyframeStore& keyframes) {
  std::vector<float> logs;
  for (std::size_t i = 0; i < keyframes.size(); ++i)
    logs.push_back(static_cast<float>(log_gain_of(static_cast<int>(i))));
  return {.gaussians = sea_bed(),
          .medium = water,
          .log_gains = torch::tensor(logs),
          .vignetting = kVignetting};
}

medium::Medium scaled(double factor) {
  const medium::Medium water = true_water();
  return {.beta_d = factor * water.beta_d, .beta_b = factor * water.beta_b, .b_inf = water.b_inf};
}

TEST(RangeBias, TrueMediumLeavesLittleOfTheBiasOfTheImages) {
  const KeyframeStore keyframes = dive();
  const auto bias = range_bias(bed_in(true_water(), keyframes), keyframes, all_of(keyframes));
  ASSERT_TRUE(bias);
  EXPECT_GE(bias->points, 50);
  EXPECT_GT(bias->range_spread_m, 0.1);
  for (std::size_t c = 0; c < 3; ++c) {
    EXPECT_GT(std::abs(bias->image[c]), 0.02) << c;
    EXPECT_LT(std::abs(bias->restored[c]), 0.15 * std::abs(bias->image[c])) << c;
  }
}

TEST(RangeBias, HasTheSignOfWhatIsLeft) {
  const KeyframeStore keyframes = dive();
  const auto weak = range_bias(bed_in(scaled(0.5), keyframes), keyframes, all_of(keyframes));
  const auto strong = range_bias(bed_in(scaled(1.5), keyframes), keyframes, all_of(keyframes));
  ASSERT_TRUE(weak && strong);
  EXPECT_LT(weak->restored[0], -0.02);   // red still darkens with range
  EXPECT_GT(strong->restored[0], 0.02);  // more was added than was lost
}

TEST(RangeBias, IsAbsentWithoutMediumOrWithFewViews) {
  const KeyframeStore keyframes = dive();
  Map map = bed_in(true_water(), keyframes);
  EXPECT_FALSE(range_bias(map, keyframes, {0, 1}));
  map.medium.reset();
  EXPECT_FALSE(range_bias(map, keyframes, all_of(keyframes)));
}

}  // namespace
}  // namespace apvi::mapping
