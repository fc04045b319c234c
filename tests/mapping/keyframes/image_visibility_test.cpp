// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/keyframes/image_visibility.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kWidth = 320;
constexpr std::int64_t kHeight = 240;

/// Image of gray levels [H,W] with sensor noise.
Tensor image(const Tensor& gray, double noise, std::uint64_t seed = 5) {
  torch::manual_seed(seed);
  const Tensor rgb = gray.unsqueeze(2).expand({gray.size(0), gray.size(1), 3});
  return (rgb + noise * torch::randn(rgb.sizes())).round().clamp(0, 255).to(torch::kUInt8);
}

/// Brighter in the center, as lit by a lamp.
Tensor lamp_light() {
  const Tensor y = torch::linspace(-1, 1, kHeight).unsqueeze(1);
  const Tensor x = torch::linspace(-1, 1, kWidth).unsqueeze(0);
  return 40.0 + 80.0 * torch::exp(-(x.square() + y.square()));
}

/// Sand ripples.
Tensor ripples(double gray_levels) {
  const Tensor x = torch::arange(kWidth, torch::kFloat32).unsqueeze(0);
  const Tensor y = torch::arange(kHeight, torch::kFloat32).unsqueeze(1);
  return gray_levels * torch::sin(0.25 * x + 0.08 * y);
}

TEST(ImageVisibility, LampLitSiltHasLowVisibilityAtAnyNoise) {
  for (const double noise : {0.0, 1.0, 4.0, 12.0}) {
    EXPECT_TRUE(has_low_visibility(image(lamp_light(), noise))) << noise;
    EXPECT_FALSE(is_black(image(lamp_light(), noise))) << noise;
  }
}

TEST(ImageVisibility, FaintSandIsVisible) {
  EXPECT_FALSE(has_low_visibility(image(lamp_light() + ripples(8.0), 8.0)));
  EXPECT_TRUE(has_low_visibility(image(lamp_light() + ripples(0.5), 8.0)));
}

TEST(ImageVisibility, FineGravelIsVisible) {
  torch::manual_seed(8);
  const Tensor grains = 30.0 * torch::randn({kHeight, kWidth});
  EXPECT_FALSE(has_low_visibility(image(lamp_light() + grains, 2.0)));
}

TEST(ImageVisibility, DetailInAFifthOfTheImageIsEnough) {
  Tensor gray = lamp_light();
  gray.slice(1, 0, kWidth / 5).add_(ripples(20.0).slice(1, 0, kWidth / 5));
  EXPECT_FALSE(has_low_visibility(image(gray, 4.0)));
}

TEST(ImageVisibility, MarineSnowAloneHasLowVisibility) {
  Tensor gray = lamp_light();
  for (std::int64_t k = 0; k < 12; ++k) {
    const std::int64_t x = 11 + 25 * k;
    const std::int64_t y = (37 * k) % (kHeight - 5);
    gray.slice(0, y, y + 3).slice(1, x, x + 3).fill_(250.0);
  }
  EXPECT_TRUE(has_low_visibility(image(gray, 4.0)));
}

TEST(ImageVisibility, GlareHasLowVisibilityAndDarknessIsBlack) {
  EXPECT_TRUE(has_low_visibility(image(170.0 + 2.0 * lamp_light(), 4.0)));
  EXPECT_TRUE(is_black(image(torch::ones({kHeight, kWidth}), 1.0)));
}

TEST(ImageVisibility, SmallImagesAreNotRejected) {
  EXPECT_FALSE(has_low_visibility(image(torch::full({3, 3}, 90.0), 0.0)));
  EXPECT_FALSE(has_low_visibility(image(torch::full({120, 160}, 90.0), 4.0)));
}

TEST(ImageVisibility, WhatTheMaskHidesIsNoDetail) {
  Tensor gray = lamp_light();
  gray.slice(0, 180).add_(ripples(40.0).slice(0, 180));  // a part of the vehicle
  const Tensor scene = torch::ones({kHeight, kWidth}, torch::kBool);
  scene.slice(0, 175).fill_(false);
  EXPECT_FALSE(has_low_visibility(image(gray, 4.0)));
  EXPECT_TRUE(has_low_visibility(image(gray, 4.0), scene));
  gray.slice(0, 0, 180).fill_(0.0);
  EXPECT_FALSE(is_black(image(gray, 1.0)));
  EXPECT_TRUE(is_black(image(gray, 1.0), scene));
  scene.fill_(false);
  EXPECT_TRUE(is_black(image(gray, 1.0), scene));
  EXPECT_TRUE(has_low_visibility(image(gray, 1.0), scene));
}

}  // namespace
}  // namespace apvi::mapping
