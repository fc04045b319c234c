// SPDX-License-Identifier: BSD-3-Clause
#include "medium/vignetting.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

namespace apvi::medium {
namespace {

TEST(Vignetting, FollowsTheNaturalFalloffOfAWideCamera) {
  const torch::Tensor s = torch::linspace(0.0, 1.0, 101, torch::kFloat64);
  const double tangent = std::tan(0.6981);  // 40 degrees from the axis to a corner
  const torch::Tensor cos4 = (1.0 + tangent * tangent * s).square().reciprocal();
  const torch::Tensor terms = torch::stack({s, s.square()}, 1);
  const torch::Tensor fit = torch::linalg_solve(
      terms.t().mm(terms), terms.t().mm(-cos4.log().unsqueeze(1)), /*left=*/true);
  const Vignetting lens{.square = fit[0].item<double>(), .fourth = fit[1].item<double>()};
  EXPECT_LT((lens.factor(s) - cos4).abs().max().item<double>(), 0.01);
  EXPECT_EQ(lens.confined().square, lens.square);
  EXPECT_EQ(lens.confined().fourth, lens.fourth);
}

TEST(Vignetting, IsConfinedToDarkeningTowardTheCorners) {
  const torch::Tensor s = torch::linspace(0.0, 1.0, 101, torch::kFloat64);
  for (const Vignetting wild :
       {Vignetting{-0.5, 0.1}, Vignetting{0.4, -2.0}, Vignetting{9.0, 9.0}, Vignetting{1.0, 5.0}}) {
    const torch::Tensor factor = wild.confined().factor(s);
    EXPECT_LE(factor.diff().max().item<double>(), 1e-12);
    EXPECT_GE(factor.min().item<double>(), 0.0497);
  }
  EXPECT_TRUE(Vignetting().is_none());
}

}  // namespace
}  // namespace apvi::medium
