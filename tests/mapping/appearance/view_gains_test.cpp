// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/appearance/view_gains.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/rendering.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

TEST(InterpolateGains, FollowsNearbyEstimatesAndTheMedianElsewhere) {
  // One view per second with a gap of ten seconds; the last estimate before the gap is an outlier.
  const std::vector<double> seconds = {0.0, 1.0, 2.0, 3.0, 4.0, 14.0, 15.0};
  const Tensor logs = torch::tensor({0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7}, torch::kFloat64);
  const std::vector<std::size_t> views = {0, 1, 3};
  const Tensor found = torch::tensor({0.15, 0.25, -0.6}, torch::kFloat64);
  const Tensor after = interpolate_gains(logs, seconds, views, found);
  const auto change = [&](int i) { return (after[i] - logs[i]).item<double>(); };
  EXPECT_NEAR(change(0), 0.05, 1e-12);
  EXPECT_NEAR(change(1), 0.05, 1e-12);
  EXPECT_NEAR(change(3), -1.0, 1e-12);
  // Halfway between two estimates: nearly their mean.
  EXPECT_NEAR(change(2), -0.475, 0.05);
  // A second later: still most of the change. After the gap: the median.
  EXPECT_LT(change(4), -0.6);
  EXPECT_GT(change(5), 0.0);
  EXPECT_NEAR(change(6), 0.05, 0.03);
}

TEST(InterpolateGains, ReturnsTheMedianBetweenDistantViews) {
  const std::vector<double> seconds = {0.0, 500.0, 1e5};
  const Tensor after = interpolate_gains(torch::zeros({3}, torch::kFloat64), seconds, {0, 2},
                                         torch::tensor({0.2, 0.3}, torch::kFloat64));
  EXPECT_NEAR(after[1].item<double>(), 0.2, 1e-9);  // the median is the lower of the middle two
  EXPECT_NEAR(after[2].item<double>(), 0.3, 1e-12);
}

/// 20 x 30 pixels, all on a surface.
RenderedView solid_view() {
  torch::manual_seed(3);
  return {.image = 0.5 * torch::rand({20, 30, 3}),
          .alpha = torch::ones({20, 30}),
          .open_water = Tensor()};
}

TEST(ViewGains, InitializesFromTheBrightnessRatio) {
  const RenderedView solid = solid_view();
  ViewGains gains(2, torch::kCPU);
  gains.initialize(1, solid, 1.3 * solid.image);
  EXPECT_NEAR(std::exp(gains.log_gain(1).item<float>()), 1.3, 1e-3);
  EXPECT_FLOAT_EQ(gains.log_gain(0).item<float>(), 0.0F);
  gains.add_view();
  EXPECT_FLOAT_EQ(gains.log_gain(2).item<float>(), gains.log_gain(1).item<float>());
  RenderedView nothing_solid = solid;
  nothing_solid.alpha = torch::zeros_like(solid.alpha);
  gains.initialize(2, nothing_solid, 3.0 * solid.image);
  EXPECT_FLOAT_EQ(gains.log_gain(2).item<float>(), gains.log_gain(1).item<float>());
  RenderedView dark = solid;
  dark.image = torch::zeros_like(solid.image);
  gains.initialize(2, dark, solid.image);
  EXPECT_FLOAT_EQ(gains.log_gain(2).item<float>(), gains.log_gain(1).item<float>());
}

TEST(ViewGains, InitializesUnderGlareInOneUpdate) {
  const RenderedView solid = solid_view();
  ViewGains gains(1, torch::kCPU);
  gains.initialize(0, solid, 0.3 * solid.image);
  EXPECT_NEAR(std::exp(gains.log_gain(0).item<float>()), 0.3, 1e-3);
}

/// Log gain of a view whose image equals the rendering except in its top fifth, which the map does
/// not cover and which has a uniform `color`.
float gain_beneath(const Tensor& color, const Tensor& water, bool hidden = false,
                   const Horizon& horizon = kNoSky) {
  RenderedView view = solid_view();
  view.open_water = water.expand({20, 30, 3}).contiguous();
  if (hidden) {
    view.image.narrow(0, 0, 4).copy_(water.expand({4, 30, 3}));
  } else {
    view.alpha.narrow(0, 0, 4).zero_();
  }
  view.horizon = horizon;
  Tensor image = view.image.clone();
  image.narrow(0, 0, 4).copy_(color.expand({4, 30, 3}));
  ViewGains gains(1, torch::kCPU);
  gains.initialize(0, view, image);
  return gains.log_gain(0).item<float>();
}

TEST(ViewGains, WeightsOpenWaterMoreThanSurfaces) {
  const Tensor water = torch::tensor({0.1F, 0.3F, 0.4F});
  EXPECT_NEAR(gain_beneath(water, water), 0.0, 1e-4);
  // Open water, 10 % brighter in a tenth of the pixels (the rest is within the margin of an edge),
  // has five times the weight: two fifths of the total.
  EXPECT_NEAR(gain_beneath(1.1 * water, water), std::log(1.04), 0.005);
  // Much brighter colors and other hues are not open water.
  EXPECT_NEAR(gain_beneath(1.5 * water, water), 0.0, 1e-4);
  EXPECT_NEAR(gain_beneath(torch::tensor({0.2F, 0.3F, 0.4F}), water), 0.0, 1e-4);
}

TEST(ViewGains, UsesOpenWaterAboveTheHorizonEvenIfCovered) {
  const Tensor water = torch::tensor({0.1F, 0.3F, 0.4F});
  const Horizon in_row_four{0.0F, -1.0F, 4.0F};
  EXPECT_NEAR(gain_beneath(1.1 * water, water, true, in_row_four), std::log(1.1), 0.005);
  EXPECT_NEAR(gain_beneath(1.1 * water, water, false, in_row_four), std::log(1.1), 0.005);
  const Horizon over_the_image{0.0F, -1.0F, 0.0F};
  EXPECT_LT(gain_beneath(1.1 * water, water, true, over_the_image), 0.03);
}

TEST(ViewGains, UsesOnlyUnsaturatedChannelsOfOpenWater) {
  const Tensor bright = torch::tensor({0.1F, 0.5F, 0.95F});
  const Tensor clipped = (1.1 * bright).clamp_max(1.0);
  EXPECT_NEAR(gain_beneath(clipped, bright), gain_beneath(1.1 * bright, bright), 1e-6);
  EXPECT_GT(gain_beneath(clipped, bright), 0.02F);
  // One channel alone does not determine a hue.
  const Tensor glare = torch::tensor({0.11F, 1.0F, 1.0F});
  EXPECT_NEAR(gain_beneath(glare, torch::tensor({0.1F, 0.95F, 0.95F})), 0.0, 1e-4);
}

TEST(ViewGains, DoNotDriftWhenTheMapIsTwoPercentTooBright) {
  const RenderedView solid = solid_view();
  const double darker = std::log(0.7);  // one view out of twenty
  ViewGains gains(20, torch::kCPU);
  for (int k = 0; k < 8000; ++k) {
    const std::size_t view = static_cast<std::size_t>(k) % 20;
    const double truth = view == 7 ? darker : 0.0;
    RenderedView learned = solid;
    learned.image = 1.02 * solid.image * (darker / 20.0 - gains.logs().mean()).exp();
    gains.track(view, learned, std::exp(truth) * solid.image);
  }
  EXPECT_NEAR(gains.log_gain(3).item<float>(), 0.0, 0.03);
  EXPECT_NEAR(gains.log_gain(7).item<float>(), darker, 0.03);
}

TEST(ViewGains, DoNotDriftWhenNewAreasAreFivePercentTooDark) {
  const RenderedView solid = solid_view();
  ViewGains gains(0, torch::kCPU);
  for (std::size_t view = 0; view < 200; ++view) {
    gains.add_view();
    RenderedView drawn = solid;  // the map reproduces the last image with its gain
    drawn.image = 0.95 * solid.image / gains.log_gain(view).exp();
    gains.initialize(view, drawn, solid.image);
    EXPECT_LT(gains.log_gain(view).item<float>(), 0.18F) << view;
  }
  EXPECT_LT(gains.log_gain(199).item<float>(), 0.02F);
}

TEST(CameraGain, IsInterpolatedInTimeForHeldOutImages) {
  KeyframeStore store;
  for (int i = 0; i < 4; ++i) {
    Keyframe keyframe;
    keyframe.stamp_ns = i == 2 ? 30 : 10 * i;
    if (i == 3) keyframe.stamp_ns = 50;
    keyframe.intrinsics = {.fx = 4.0, .fy = 4.0, .cx = 2.0, .cy = 2.0, .width = 4, .height = 4};
    keyframe.T_camera_world = torch::eye(4, torch::kFloat64);
    keyframe.image = torch::zeros({4, 4, 3}, torch::kUInt8);
    keyframe.held_out = i == 0 || i == 2;
    store.add(std::move(keyframe));
  }
  Map map = {.gaussians = gaussians::Gaussians::empty(0, torch::kFloat32), .medium = std::nullopt};
  EXPECT_FLOAT_EQ(camera_gain(map, store, 1).item<float>(), 1.0F);
  map.log_gains = torch::tensor({9.0F, 0.2F, 9.0F, 0.6F});
  EXPECT_NEAR(std::log(camera_gain(map, store, 1).item<float>()), 0.2, 1e-6);
  EXPECT_NEAR(std::log(camera_gain(map, store, 2).item<float>()), 0.4, 1e-6);
  EXPECT_NEAR(std::log(camera_gain(map, store, 0).item<float>()), 0.2, 1e-6);
  map.vignetting = {.square = 0.7};
  const Tensor response = camera_response(map, store, 1, 1);
  EXPECT_EQ(response.sizes(), at::IntArrayRef({4, 4, 1}));
  EXPECT_LT(response[0][0].item<float>(), 0.85F * response[1][1].item<float>());
}

TEST(ViewGains, AFinishedMapHasNoUsualDifference) {
  ViewGains gains(3, torch::kCPU);
  const torch::Tensor image = torch::full({8, 8, 3}, 0.25F);
  const RenderedView rendered = {
      .image = image, .alpha = torch::ones({8, 8}), .open_water = {}, .horizon = kNoSky};
  for (std::size_t i = 0; i < 3; ++i) gains.measure(i, rendered, 1.5 * image);
  EXPECT_TRUE(torch::allclose(gains.logs(), torch::full({3}, std::log(1.5F))));
}

TEST(ViewGains, RestoresAHeldMedian) {
  ViewGains gains(4, torch::kCPU);
  gains.set_logs(torch::tensor({0.1F, 0.2F, 0.3F, 5.0F}));
  gains.restore_median();
  EXPECT_TRUE(torch::equal(gains.logs(), torch::tensor({0.1F, 0.2F, 0.3F, 5.0F})));
  gains.hold_median({0, 1, 2});
  gains.set_logs(torch::tensor({0.0F, 0.4F, 0.5F, 6.0F}));
  gains.restore_median();
  EXPECT_TRUE(torch::allclose(gains.logs(), torch::tensor({-0.2F, 0.2F, 0.3F, 5.8F})));
}

}  // namespace
}  // namespace apvi::mapping
