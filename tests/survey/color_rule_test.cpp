// SPDX-License-Identifier: BSD-3-Clause
#include "survey/color_rule.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

namespace apvi::survey {
namespace {

TEST(ColorRule, RestoredLightHasTheExposureOfTheMap) {
  ColorRule rule;
  rule.exposure = {.brightness = 2.0, .balance = {1.0, 0.5, 0.25}};
  const torch::Tensor values = rule(torch::full({1, 3}, 0.3F));
  EXPECT_TRUE(torch::allclose(values, torch::tensor({{0.6F, 0.3F, 0.15F}})));
}

TEST(ColorRule, AttenuatedLightHasTheToneCurveAndNoExposure) {
  ColorRule rule;
  rule.exposure.brightness = 5.0;
  rule.curve = {.gamma = 2.0, .offset = 0.0};
  rule.transmission = torch::tensor({0.25, 0.5, 1.0});
  const torch::Tensor values = rule(torch::full({2, 2, 3}, 0.64F));
  const torch::Tensor truth = torch::tensor({0.4F, 0.8F * std::sqrt(0.5F), 0.8F});
  EXPECT_TRUE(torch::allclose(values, truth.expand({2, 2, 3})));
}

}  // namespace
}  // namespace apvi::survey
