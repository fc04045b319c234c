// SPDX-License-Identifier: BSD-3-Clause
#include "change/neighborhoods.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

namespace apvi::change {
namespace {

TEST(Neighborhoods, QuantilesAreThoseOfABlockAndItsNeighbors) {
  const torch::Tensor x = torch::arange(6, torch::kFloat64) + 0.5;
  const torch::Tensor points =
      torch::stack({x, torch::zeros_like(x), torch::zeros_like(x)}, 1).to(torch::kFloat32);
  const torch::Tensor values = torch::tensor({0.0F, 10.0F, 20.0F, 30.0F, 40.0F, 50.0F});
  const Neighborhoods neighborhoods(points, 1.0);
  const torch::Tensor largest = neighborhoods.quantiles(values.unsqueeze(1), 1.0).squeeze(1);
  EXPECT_TRUE(torch::equal(largest, torch::tensor({10.0F, 20.0F, 30.0F, 40.0F, 50.0F, 50.0F})));
  const torch::Tensor middle = neighborhoods.quantiles(values.unsqueeze(1), 0.5).squeeze(1);
  EXPECT_EQ(middle[2].item<float>(), 20.0F);
}

TEST(DeviationsBySupport, AreThoseOfTheNoiseAndDoNotSeeATenthOfOutliers) {
  torch::manual_seed(3);
  const torch::Tensor support = torch::arange(20000).div(10000, "floor").to(torch::kFloat32);
  const torch::Tensor sigma = 2.0 - 1.5 * support;
  torch::Tensor values = sigma * torch::randn({20000});
  values.slice(0, 10000, 20000, 20).fill_(100.0);
  const torch::Tensor found = deviations_by_support(values.unsqueeze(1), support).squeeze(1);
  EXPECT_NEAR(found[0].item<double>(), 2.0, 0.15);
  EXPECT_NEAR(found[19999].item<double>(), 0.6, 0.1);  // a twentieth of outliers
}

}  // namespace
}  // namespace apvi::change
