// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/water_survey.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <vector>

#include "apvi/mapping/seeds.hpp"
#include "apvi/mapping/view_gains.hpp"
#include "apvi/splat/medium_estimate.hpp"
#include "apvi/splat/ply.hpp"
#include "apvi/splat/render.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kVignetting = 0.2;

splat::Medium true_water() {
  return {.beta_d = torch::tensor({0.30, 0.14, 0.16}),
          .beta_b = torch::tensor({0.29, 0.135, 0.15}),
          .b_inf = torch::tensor({0.05, 0.20, 0.18})};
}

/// A sea bed of soft colours, 8 m wide and 12 m long, some two metres below the cameras.
splat::Gaussians sea_bed() {
  const Tensor x = torch::linspace(-4.0, 4.0, 61).reshape({61, 1}).expand({61, 91}).flatten();
  const Tensor z = torch::linspace(0.0, 12.0, 91).reshape({1, 91}).expand({61, 91}).flatten();
  const Tensor y = 1.0 + 0.1 * torch::sin(1.3 * x) * torch::cos(1.1 * z);
  const std::int64_t n = x.size(0);
  const Tensor phase = torch::tensor({0.0, 2.0, 4.0});
  const Tensor pattern =
      torch::sin(2.1 * x.unsqueeze(1) + phase) * torch::cos(1.7 * z.unsqueeze(1) - 0.5 * phase);
  return {.means = torch::stack({x, y, z}, 1),
          .log_scales = torch::tensor({0.1, 0.02, 0.1}).log().repeat({n, 1}),
          .quaternions = torch::tensor({1.0F, 0.0F, 0.0F, 0.0F}).repeat({n, 1}),
          .logit_opacities = torch::full({n}, 4.0F),
          .sh_dc = splat::color_to_sh_dc(0.45 + 0.35 * pattern),
          .sh_rest = torch::zeros({n, 0, 3})};
}

Tensor pose_at(double x, double y, double z, double pitch) {
  const Tensor R = torch::tensor({1.0, 0.0, 0.0,                           //
                                  0.0, std::cos(pitch), -std::sin(pitch),  //
                                  0.0, std::sin(pitch), std::cos(pitch)},
                                 torch::kFloat64)
                       .reshape({3, 3});
  Tensor T = torch::eye(4, torch::kFloat64);
  T.slice(0, 0, 3).slice(1, 0, 3).copy_(R);
  T.slice(0, 0, 3).select(1, 3).copy_(-torch::matmul(R, torch::tensor({x, y, z}, torch::kFloat64)));
  return T;
}

double log_gain_of(int i) {
  return 0.2 * std::sin(1.1 * i);
}

/// Pictures through water by a camera that exposes by itself.
KeyframeStore dive(const splat::Gaussians& bed) {
  const torch::NoGradGuard no_grad;
  KeyframeStore store;
  for (int i = 0; i < 14; ++i) {
    Keyframe keyframe;
    keyframe.stamp_ns = i;
    keyframe.name = std::to_string(i);
    keyframe.intrinsics = {
        .fx = 110.0, .fy = 110.0, .cx = 80.0, .cy = 60.0, .width = 160, .height = 120};
    keyframe.T_camera_world = pose_at(0.8 * std::sin(1.7 * i), 0.3 * std::cos(2.3 * i) - 0.8,
                                      0.35 * i, 0.75 + 0.1 * (i % 3));
    splat::View view;
    view.intrinsics = keyframe.intrinsics;
    view.T_camera_world = keyframe.T_camera_world;
    const splat::RenderOutput out = splat::render(bed, view, {});
    const Tensor seen = splat::apply_medium(
        out.color, splat::depth_to_range(out.depth, view.intrinsics), out.alpha, true_water());
    const Tensor response =
        std::exp(log_gain_of(i)) * lens_falloff(view.intrinsics, kVignetting, torch::kCPU);
    keyframe.image = ((seen * response).clamp(0.0, 1.0) * 255.0 + 0.5).to(torch::kUInt8);
    store.add(std::move(keyframe));
  }
  return store;
}

double worst_relative_error(const Tensor& got, const Tensor& truth) {
  return ((got - truth).abs() / truth).max().item<double>();
}

TEST(SurveyWater, FindsWaterAndCameraFromAMapAndItsKeyframes) {
  const splat::Gaussians bed = sea_bed();
  const KeyframeStore keyframes = dive(bed);
  const auto survey = survey_water({.gaussians = bed, .medium = std::nullopt}, keyframes, 0.1,
                                   {.medium = splat::coastal_medium()}, 1);
  ASSERT_TRUE(survey);
  EXPECT_EQ(survey->views.size(), 14U);
  EXPECT_LT(worst_relative_error(survey->fit.medium.beta_d, true_water().beta_d), 0.2);
  // How fast so faint a veil grows can hardly be seen; how bright it becomes can.
  EXPECT_LT(worst_relative_error(survey->fit.medium.b_inf, true_water().b_inf), 0.2);
  EXPECT_NEAR(survey->fit.vignetting, kVignetting, 0.02);
  double mean = 0.0;
  for (int i = 0; i < 14; ++i) mean += log_gain_of(i) / 14.0;
  for (int i = 0; i < 14; ++i) {
    EXPECT_NEAR(survey->fit.log_gains[i].item<double>(), log_gain_of(i) - mean, 0.03) << i;
  }
}

TEST(SurveyWater, FindsNothingInAnEmptyMapOrInOneView) {
  const splat::Gaussians bed = sea_bed();
  const KeyframeStore keyframes = dive(bed);
  const WaterPrior prior = {.medium = splat::coastal_medium()};
  EXPECT_FALSE(survey_water(
      {.gaussians = splat::Gaussians::empty(0, torch::kFloat32), .medium = std::nullopt}, keyframes,
      0.1, prior, 1));
  EXPECT_FALSE(
      survey_water({.gaussians = bed, .medium = std::nullopt}, keyframes, 100.0, prior, 1));
  EXPECT_FALSE(
      survey_water({.gaussians = bed, .medium = std::nullopt}, KeyframeStore(), 0.1, prior, 1));
}

TEST(ViewGains, FindHowBrightAPictureIs) {
  torch::manual_seed(3);
  const Tensor drawn = 0.5 * torch::rand({20, 30, 3});
  const Tensor solid = torch::ones({20, 30});
  ViewGains gains(2, torch::kCPU);
  gains.match(1, drawn, solid, 1.3 * drawn, 1.0);
  EXPECT_NEAR(gains.gain(1).item<float>(), 1.3, 1e-3);
  EXPECT_FLOAT_EQ(gains.gain(0).item<float>(), 1.0F);
  gains.add_view();
  EXPECT_FLOAT_EQ(gains.gain(2).item<float>(), gains.gain(1).item<float>());
  gains.match(2, drawn, torch::zeros_like(solid), 3.0 * drawn, 1.0);  // nothing solid there
  EXPECT_FLOAT_EQ(gains.gain(2).item<float>(), gains.gain(1).item<float>());
  gains.match(2, torch::zeros_like(drawn), solid, drawn, 1.0);  // nor is there light
  EXPECT_FLOAT_EQ(gains.gain(2).item<float>(), gains.gain(1).item<float>());
}

TEST(CameraGain, OfAHeldOutViewLiesBetweenItsNeighboursInTime) {
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
  Map map = {.gaussians = splat::Gaussians::empty(0, torch::kFloat32), .medium = std::nullopt};
  EXPECT_FLOAT_EQ(camera_gain(map, store, 1).item<float>(), 1.0F);
  map.log_gains = torch::tensor({9.0F, 0.2F, 9.0F, 0.6F});
  EXPECT_NEAR(std::log(camera_gain(map, store, 1).item<float>()), 0.2, 1e-6);
  EXPECT_NEAR(std::log(camera_gain(map, store, 2).item<float>()), 0.4, 1e-6);
  EXPECT_NEAR(std::log(camera_gain(map, store, 0).item<float>()), 0.2, 1e-6);
  map.vignetting = 0.5;
  const Tensor response = camera_response(map, store, 1, 1);
  EXPECT_EQ(response.sizes(), at::IntArrayRef({4, 4, 1}));
  EXPECT_LT(response[0][0].item<float>(), 0.85F * response[1][1].item<float>());
}

}  // namespace
}  // namespace apvi::mapping
