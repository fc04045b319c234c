// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/water_belief.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <sstream>

#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using test::tensors_near;
using torch::Tensor;

Tensor three(double value) {
  return torch::full({3}, value, torch::kFloat64);
}

/// A survey that knows the logarithms of each channel to one sigma.
void tell(WaterBelief& belief, double log_beta, double sigma) {
  const Tensor logs = torch::tensor({log_beta, -0.1}, torch::kFloat64).expand({3, 2});
  const Tensor information =
      torch::eye(2, torch::kFloat64).div(sigma * sigma).expand({3, 2, 2}).contiguous();
  belief.add(information, logs / (sigma * sigma), logs);
}

double log_beta(const WaterBelief& belief) {
  return (belief.weighted()[0][0] / belief.information()[0][0][0]).item<double>();
}

TEST(WaterBelief, SurveysThatAreSureOfThemselvesCountAlike) {
  WaterBelief belief;
  EXPECT_TRUE(belief.empty());
  for (int i = 0; i < 30; ++i) tell(belief, std::log(i % 2 == 0 ? 0.10 : 0.14), 0.01);
  // Their stray is 0.3 and 0.2: what they claim is nothing to it.
  EXPECT_NEAR(std::exp(log_beta(belief)), 0.125, 0.01);
}

TEST(WaterBelief, OneThatSaysLittleChangesLittle) {
  WaterBelief belief;
  tell(belief, std::log(0.1), 0.05);
  tell(belief, std::log(0.4), 5.0);
  EXPECT_NEAR(std::exp(log_beta(belief)), 0.1, 0.002);
  EXPECT_TRUE(tensors_near(belief.add_veil(three(-2.0), three(0.1), false), three(-2.0), 1e-12));
  EXPECT_TRUE(
      tensors_near(belief.add_veil(three(-4.0), three(0.1), false), three(-5.6 / 1.8), 1e-12));
  EXPECT_TRUE(tensors_near(belief.add_veil(three(9.0), three(9.0), false), three(-5.6 / 1.8), 0.1));
}

TEST(WaterBelief, WhoSawOpenWaterKnowsHowBrightItIs) {
  WaterBelief belief;
  belief.add_veil(three(-2.0), three(0.1), false);
  EXPECT_TRUE(tensors_near(belief.add_veil(three(-1.0), three(0.01), true), three(-1.0), 0.1));
}

TEST(WaterBelief, IsTheSameWhenReadAgain) {
  WaterBelief belief;
  tell(belief, std::log(0.1), 0.05);
  belief.add_veil(three(-2.0), three(0.1), false);
  std::stringstream file;
  torch::serialize::OutputArchive out;
  belief.save(out);
  out.save_to(file);
  torch::serialize::InputArchive in;
  in.load_from(file);
  WaterBelief read;
  read.load(in);
  EXPECT_TRUE(torch::equal(read.information(), belief.information()));
  EXPECT_TRUE(torch::equal(read.weighted(), belief.weighted()));
  EXPECT_TRUE(torch::equal(read.add_veil(three(-3.0), three(0.2), false),
                           belief.add_veil(three(-3.0), three(0.2), false)));
}

}  // namespace
}  // namespace apvi::mapping
