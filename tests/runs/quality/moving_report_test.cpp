// SPDX-License-Identifier: BSD-3-Clause
#include "runs/quality/moving_report.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

namespace apvi::runs {
namespace {

torch::Tensor nothing_moves() {
  return torch::zeros({60, 100}, torch::kBool);
}

void set(torch::Tensor& lowered, int top, int left, int height, int width) {
  lowered.slice(0, top, top + height).slice(1, left, left + width).fill_(true);
}

TEST(MovingRegions, AreConnectedPixelsTheLargerOnesFirst) {
  torch::Tensor lowered = nothing_moves();
  set(lowered, 5, 10, 3, 4);
  set(lowered, 30, 50, 10, 20);
  const auto regions = moving_regions(lowered);
  ASSERT_EQ(regions.size(), 2U);
  EXPECT_EQ(regions[0].left, 50);
  EXPECT_EQ(regions[0].top, 30);
  EXPECT_EQ(regions[0].width, 20);
  EXPECT_EQ(regions[0].height, 10);
  EXPECT_EQ(regions[0].pixels, 200);
  EXPECT_EQ(regions[1].pixels, 12);
}

TEST(MovingRegions, BelowAThousandthOfTheImageAreLeftOut) {
  torch::Tensor lowered = nothing_moves();
  set(lowered, 5, 10, 1, 5);
  set(lowered, 40, 10, 1, 6);
  const auto regions = moving_regions(lowered);
  ASSERT_EQ(regions.size(), 1U);
  EXPECT_EQ(regions[0].pixels, 6);
}

TEST(MovingRegions, OfAnImageInWhichNothingMovesAreNone) {
  EXPECT_TRUE(moving_regions(nothing_moves()).empty());
}

}  // namespace
}  // namespace apvi::runs
