// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/render/tone_curve.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

#include "gaussians/model/point_cloud.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

const auto kF64 = torch::dtype(torch::kFloat64);

double largest(const Tensor& difference) {
  return difference.abs().max().item<double>();
}

class ToneCurves : public testing::TestWithParam<ToneCurve> {};

TEST_P(ToneCurves, DecodeInvertsEncodeBeyondBlackAndWhiteToo) {
  const Tensor light = torch::linspace(-0.01, 1.5, 3000, kF64);
  EXPECT_LT(largest(GetParam().decode(GetParam().encode(light)) - light), 1e-9);
}

TEST_P(ToneCurves, BlackAndWhiteKeepTheirValues) {
  const Tensor ends = torch::tensor({0.0, 1.0}, kF64);
  EXPECT_LT(largest(GetParam().encode(ends) - ends), 1e-12);
}

TEST_P(ToneCurves, SlopeAndGradientAreTheNumericDerivative) {
  constexpr double kStep = 1e-7;
  const Tensor light = torch::linspace(0.01, 1.2, 500, kF64).requires_grad_(true);
  GetParam().encode(light).sum().backward();
  const torch::NoGradGuard no_grad;
  const Tensor numeric =
      (GetParam().encode(light + kStep) - GetParam().encode(light - kStep)) / (2.0 * kStep);
  EXPECT_LT(largest(GetParam().slope(light) - numeric), 1e-4);
  EXPECT_LT(largest(light.grad() - numeric), 1e-4);
}

TEST_P(ToneCurves, ColorsOfGaussiansSurviveEncodingAndDecoding) {
  torch::manual_seed(3);
  Gaussians map = Gaussians::empty(3, torch::kFloat64);
  map.sh_dc = color_to_sh_dc(torch::rand({50, 3}, kF64));
  map.sh_rest = 0.1 * torch::randn({50, 15, 3}, kF64);
  const Gaussians back = with_decoded_colors(with_encoded_colors(map, GetParam()), GetParam());
  EXPECT_LT(largest(back.sh_dc - map.sh_dc), 1e-9);
  EXPECT_LT(largest(back.sh_rest - map.sh_rest), 1e-9);
}

INSTANTIATE_TEST_SUITE_P(All, ToneCurves,
                         testing::Values(ToneCurve{}, ToneCurve{.gamma = 2.2}, kSrgb,
                                         ToneCurve{.gamma = 1.4}));

TEST(ToneCurve, SrgbHasItsStandardValues) {
  const Tensor values = torch::tensor({0.04045, 0.5, 0.735357}, kF64);
  const Tensor light = torch::tensor({0.0031308, 0.2140411, 0.5}, kF64);
  EXPECT_LT(largest(kSrgb.decode(values) - light), 2e-6);
}

TEST(ToneCurve, ByteTableHoldsTheLightOfEachByte) {
  const Tensor table = ToneCurve{.gamma = 2.2}.byte_table(torch::kCPU);
  ASSERT_EQ(table.numel(), 256);
  EXPECT_NEAR(table[128].item<double>(), std::pow(128.0 / 255.0, 2.2), 1e-6);
  EXPECT_EQ(table[0].item<double>(), 0.0);
  EXPECT_NEAR(table[255].item<double>(), 1.0, 1e-6);
  EXPECT_FALSE(ToneCurve{}.byte_table(torch::kCPU).defined());
}

TEST(ToneCurve, ViewDependentColorsAreEncodedToFirstOrder) {
  Gaussians map = Gaussians::empty(1, torch::kFloat64);
  map.sh_dc = color_to_sh_dc(torch::full({1, 3}, 0.2, kF64));
  map.sh_rest = torch::full({1, 3, 3}, 1e-4, kF64);
  const ToneCurve curve{.gamma = 2.2};
  const Gaussians shown = with_encoded_colors(map, curve);
  const double slope = curve.slope(torch::full({1}, 0.2, kF64)).item<double>();
  EXPECT_NEAR(shown.sh_rest[0][0][0].item<double>(), slope * 1e-4, 1e-12);
}

TEST(ToneCurve, ArchivesKeepItAndRefuseNonsense) {
  EXPECT_EQ(tone_curve_of(to_tensor(kSrgb)), kSrgb);
  EXPECT_THROW(tone_curve_of(torch::tensor({-1.0, 0.0}, kF64)), c10::Error);
  EXPECT_THROW(tone_curve_of(torch::zeros({3}, kF64)), c10::Error);
}

}  // namespace
}  // namespace apvi::gaussians
