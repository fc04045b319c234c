// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/picture_content.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kWidth = 320;
constexpr std::int64_t kHeight = 240;

/// A picture of grey levels [H,W] and a sensor's noise.
Tensor picture(const Tensor& grey, double noise, std::uint64_t seed = 5) {
  torch::manual_seed(seed);
  const Tensor rgb = grey.unsqueeze(2).expand({grey.size(0), grey.size(1), 3});
  return (rgb + noise * torch::randn(rgb.sizes())).round().clamp(0, 255).to(torch::kUInt8);
}

/// Lit more in the middle, as by a lamp.
Tensor glow() {
  const Tensor y = torch::linspace(-1, 1, kHeight).unsqueeze(1);
  const Tensor x = torch::linspace(-1, 1, kWidth).unsqueeze(0);
  return 40.0 + 80.0 * torch::exp(-(x.square() + y.square()));
}

/// Ripples of sand.
Tensor ripples(double grey_levels) {
  const Tensor x = torch::arange(kWidth, torch::kFloat32).unsqueeze(0);
  const Tensor y = torch::arange(kHeight, torch::kFloat32).unsqueeze(1);
  return grey_levels * torch::sin(0.25 * x + 0.08 * y);
}

TEST(PictureContent, SiltBeforeTheLampIsMurkyHoweverNoisy) {
  for (const double noise : {0.0, 1.0, 4.0, 12.0}) {
    EXPECT_TRUE(is_murky(picture(glow(), noise))) << noise;
    EXPECT_FALSE(is_black(picture(glow(), noise))) << noise;
  }
}

TEST(PictureContent, SandAsFaintAsTheNoiseIsStillSomething) {
  EXPECT_FALSE(is_murky(picture(glow() + ripples(8.0), 8.0)));
  EXPECT_TRUE(is_murky(picture(glow() + ripples(0.5), 8.0)));
}

TEST(PictureContent, GravelAsFineAsPixelsIsNoNoise) {
  torch::manual_seed(8);
  const Tensor grains = 30.0 * torch::randn({kHeight, kWidth});
  EXPECT_FALSE(is_murky(picture(glow() + grains, 2.0)));
}

TEST(PictureContent, AFifthOfThePictureIsEnough) {
  Tensor grey = glow();
  grey.slice(1, 0, kWidth / 5).add_(ripples(20.0).slice(1, 0, kWidth / 5));
  EXPECT_FALSE(is_murky(picture(grey, 4.0)));
}

TEST(PictureContent, MarineSnowIsNoScene) {
  Tensor grey = glow();
  for (std::int64_t k = 0; k < 12; ++k) {
    const std::int64_t x = 11 + 25 * k;
    const std::int64_t y = (37 * k) % (kHeight - 5);
    grey.slice(0, y, y + 3).slice(1, x, x + 3).fill_(250.0);
  }
  EXPECT_TRUE(is_murky(picture(grey, 4.0)));
}

TEST(PictureContent, GlareIsMurkyAndDarknessBlack) {
  EXPECT_TRUE(is_murky(picture(170.0 + 2.0 * glow(), 4.0)));
  EXPECT_TRUE(is_black(picture(torch::ones({kHeight, kWidth}), 1.0)));
}

TEST(PictureContent, OfAPictureTooSmallToTellNothingIsSaid) {
  EXPECT_FALSE(is_murky(picture(torch::full({3, 3}, 90.0), 0.0)));
  EXPECT_FALSE(is_murky(picture(torch::full({120, 160}, 90.0), 4.0)));
}

}  // namespace
}  // namespace apvi::mapping
