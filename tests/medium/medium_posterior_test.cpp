// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium_posterior.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <sstream>

#include "support/torch_reference.hpp"

namespace apvi::medium {
namespace {

using test::tensors_near;
using torch::Tensor;

Tensor three(double value) {
  return torch::full({3}, value, torch::kFloat64);
}

/// An estimation with one standard deviation for all logarithms of each channel.
void add_estimation(MediumPosterior& posterior, double log_beta, double sigma) {
  const Tensor logs = torch::tensor({log_beta, -0.1}, torch::kFloat64).expand({3, 2});
  const Tensor information =
      torch::eye(2, torch::kFloat64).div(sigma * sigma).expand({3, 2, 2}).contiguous();
  posterior.add(information, logs / (sigma * sigma), logs);
}

double log_beta(const MediumPosterior& posterior) {
  return (posterior.information_mean()[0][0] / posterior.information()[0][0][0]).item<double>();
}

TEST(MediumPosterior, PreciseEstimationsHaveEqualWeight) {
  MediumPosterior posterior;
  EXPECT_TRUE(posterior.empty());
  for (int i = 0; i < 30; ++i) add_estimation(posterior, std::log(i % 2 == 0 ? 0.10 : 0.14), 0.01);
  // The assumed bias of 0.3 and 0.2 dominates their covariance.
  EXPECT_NEAR(std::exp(log_beta(posterior)), 0.125, 0.01);
}

TEST(MediumPosterior, UncertainEstimationHasLittleWeight) {
  MediumPosterior posterior;
  add_estimation(posterior, std::log(0.1), 0.05);
  add_estimation(posterior, std::log(0.4), 5.0);
  EXPECT_NEAR(std::exp(log_beta(posterior)), 0.1, 0.002);
  EXPECT_TRUE(tensors_near(posterior.add_veiling_light(three(-2.0), three(0.1), false), three(-2.0),
                           1e-12));
  EXPECT_TRUE(tensors_near(posterior.add_veiling_light(three(-4.0), three(0.1), false),
                           three(-5.6 / 1.8), 1e-12));
  EXPECT_TRUE(tensors_near(posterior.add_veiling_light(three(9.0), three(9.0), false),
                           three(-5.6 / 1.8), 0.1));
}

TEST(MediumPosterior, OpenWaterIncreasesVeilingLightWeight) {
  MediumPosterior posterior;
  posterior.add_veiling_light(three(-2.0), three(0.1), false);
  EXPECT_TRUE(
      tensors_near(posterior.add_veiling_light(three(-1.0), three(0.01), true), three(-1.0), 0.1));
}

TEST(MediumPosterior, ArchiveRoundTrip) {
  MediumPosterior posterior;
  add_estimation(posterior, std::log(0.1), 0.05);
  posterior.add_veiling_light(three(-2.0), three(0.1), false);
  std::stringstream file;
  torch::serialize::OutputArchive out;
  posterior.save(out);
  out.save_to(file);
  torch::serialize::InputArchive in;
  in.load_from(file);
  MediumPosterior read;
  read.load(in);
  EXPECT_TRUE(torch::equal(read.information(), posterior.information()));
  EXPECT_TRUE(torch::equal(read.information_mean(), posterior.information_mean()));
  EXPECT_TRUE(torch::equal(read.add_veiling_light(three(-3.0), three(0.2), false),
                           posterior.add_veiling_light(three(-3.0), three(0.2), false)));
}

}  // namespace
}  // namespace apvi::medium
