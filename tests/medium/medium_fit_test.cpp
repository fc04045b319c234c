// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium_fit.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <vector>

#include "medium/lamp.hpp"
#include "medium/medium_initialization.hpp"

namespace apvi::medium {
namespace {

using torch::Tensor;

constexpr std::int64_t kPoints = 400;
constexpr std::int64_t kViews = 12;
constexpr Vignetting kVignetting{.square = 0.4, .fourth = -0.1};
const auto kF64 = torch::dtype(torch::kFloat64);

Medium lake_water() {
  return {.beta_d = torch::tensor({0.28, 0.11, 0.14}, kF64),
          .beta_b = torch::tensor({0.275, 0.105, 0.13}, kF64),
          .b_inf = torch::tensor({0.03, 0.12, 0.11}, kF64)};
}

Tensor true_log_gains() {
  return torch::linspace(-0.3, 0.3, kViews, kF64);
}

/// Observes every point in half of the views, at ranges from `nearest` to `farthest` meters.
Observations observe(double nearest, double farthest, double noise = 0.005) {
  torch::manual_seed(7);
  const Medium water = lake_water();
  const Tensor colors = 0.05 + 0.8 * torch::rand({kPoints, 3}, kF64);
  const Tensor all = torch::rand({kPoints, kViews}, kF64) < 0.5;
  const Tensor pairs = all.nonzero();
  Observations s;
  s.points = pairs.select(1, 0).contiguous();
  s.views = pairs.select(1, 1).contiguous();
  const std::int64_t n = pairs.size(0);
  s.ranges = nearest + (farthest - nearest) * torch::rand({n}, kF64);
  s.corners2 = torch::rand({n}, kF64);
  s.texture = torch::zeros({n}, kF64);
  const Tensor z = s.ranges.unsqueeze(1);
  const Tensor seen = colors.index_select(0, s.points) * torch::exp(-water.beta_d * z) +
                      water.b_inf * (1.0 - torch::exp(-water.beta_b * z));
  const Tensor response =
      true_log_gains().exp().index_select(0, s.views) * kVignetting.factor(s.corners2);
  s.colors = 0.7 * seen * response.unsqueeze(1) + noise * torch::randn({n, 3}, kF64);
  s.point_count = kPoints;
  s.view_count = kViews;
  return s;
}

void expect_vignetting(const Vignetting& got, double tolerance) {
  const Tensor s = torch::linspace(0.1, 1.0, 10, kF64);
  EXPECT_LT((got.factor(s) - kVignetting.factor(s)).abs().max().item<double>(), tolerance);
}

double worst_relative_error(const Tensor& got, const Tensor& truth) {
  return ((got - truth).abs() / truth).max().item<double>();
}

TEST(FitMedium, RecoversMediumWithinTenPercentWhenRangesVary) {
  const auto fit = fit_medium(observe(1.5, 5.0), default_medium_prior());
  ASSERT_TRUE(fit);
  const Medium truth = lake_water();
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, truth.beta_d), 0.1);
  EXPECT_LT(worst_relative_error(fit->medium.beta_b, truth.beta_b), 0.15);
  // A gain of 0.7 also scales the veiling light.
  EXPECT_LT(worst_relative_error(fit->medium.b_inf, 0.7 * truth.b_inf), 0.15);
  expect_vignetting(fit->vignetting, 0.01);
  EXPECT_LT((fit->log_gains - true_log_gains()).abs().max().item<double>(), 0.01);
  EXPECT_GT(fit->resolution.select(1, 0).select(1, 0).min().item<double>(), 0.95);
}

TEST(FitMedium, IsIndependentOfObservationOrder) {
  const Observations s = observe(1.5, 5.0);
  Observations shuffled = s;
  const Tensor order = torch::randperm(s.ranges.size(0), torch::kInt64);
  for (Tensor Observations::*part :
       {&Observations::points, &Observations::views, &Observations::ranges, &Observations::corners2,
        &Observations::colors, &Observations::texture}) {
    shuffled.*part = (s.*part).index_select(0, order);
  }
  const auto a = fit_medium(s, default_medium_prior());
  const auto b = fit_medium(shuffled, default_medium_prior());
  ASSERT_TRUE(a && b);
  EXPECT_LT(worst_relative_error(b->medium.beta_d, a->medium.beta_d), 1e-6);
  EXPECT_LT(worst_relative_error(b->sigmas, a->sigmas), 1e-6);
  EXPECT_LT((b->log_gains - a->log_gains).abs().max().item<double>(), 1e-6);
}

// Compares the estimated covariance with the spread over forty noise draws. The fit assumes
// correlated errors of neighboring observations; these are independent, so it overestimates by 1.8.
TEST(FitMedium, CovarianceMatchesErrors) {
  std::vector<Tensor> found;
  Tensor claimed = torch::zeros({3}, kF64);
  Observations s = observe(1.5, 5.0, 0.0);
  const Tensor colors = s.colors;
  constexpr int kDraws = 40;
  for (int i = 0; i < kDraws; ++i) {
    s.colors = colors + 0.02 * torch::randn(colors.sizes(), kF64);
    const auto fit = fit_medium(s, default_medium_prior());
    ASSERT_TRUE(fit);
    found.push_back(fit->medium.beta_d.log());
    claimed += fit->sigmas.select(1, 0) / kDraws;
  }
  const Tensor ratio = claimed / torch::stack(found).std(0);
  EXPECT_GT(ratio.min().item<double>(), 1.2) << ratio;
  EXPECT_LT(ratio.max().item<double>(), 2.8) << ratio;
}

/// Observations of a sea bed lit by lamps beside the camera and some daylight.
Observations observe_with_lamp(const LampLight& light, const Medium& water = lake_water()) {
  Observations s = observe(1.0, 3.5);
  const std::int64_t n = s.ranges.size(0);
  const Tensor across = 0.5 * torch::randn({n, 2}, kF64);
  const Tensor ahead = torch::cat({across, torch::ones({n, 1}, kF64)}, 1);
  const Tensor rays = ahead / ahead.norm(2, 1, true);
  s.places = rays * s.ranges.unsqueeze(1);
  const Tensor tilt = torch::randn({n, 3}, kF64) * 0.2 + torch::tensor({0.0, 0.0, -1.0}, kF64);
  s.normals = tilt / tilt.norm(2, 1, true);
  Tensor irradiance = torch::zeros({n, 3}, kF64);
  for (const Lamp& lamp : light.lamps) {
    const auto& at = lamp.position_m;
    const Tensor from = s.places - torch::tensor({at[0], at[1], at[2]}, kF64);
    const Tensor facing = ((from * s.normals).sum(1, true) / from.norm(2, 1, true)).abs();
    irradiance +=
        facing *
        LampSum::irradiance({lamp}, light.unit_range_m, s.places).at(water.beta_d, {lamp}).value;
  }
  const Tensor lamp_backscatter =
      LampSum::backscatter(light.lamps, light.unit_range_m, rays, s.ranges)
          .at(water.beta_d, light.lamps)
          .value;
  const Tensor z = s.ranges.unsqueeze(1);
  const Tensor colors = 0.05 + 0.8 * torch::rand({kPoints, 3}, kF64);
  const Tensor direct = colors.index_select(0, s.points) *
                        (light.daylight + (1.0 - light.daylight) * irradiance) *
                        torch::exp(-water.beta_d * z);
  const Tensor seen = direct + water.b_inf * (1.0 - torch::exp(-water.beta_b * z)) +
                      light.backscatter * lamp_backscatter;
  const Tensor response =
      true_log_gains().exp().index_select(0, s.views) * kVignetting.factor(s.corners2);
  s.colors = seen * response.unsqueeze(1) + 0.003 * torch::randn({n, 3}, kF64);
  return s;
}

LampLight vehicle_lamp() {
  return {.lamps = {{.position_m = {0.25, -0.15, 0.0}}},
          .unit_range_m = 2.0,
          .daylight = torch::tensor({0.05, 0.2, 0.1}, kF64),
          .backscatter = torch::tensor({0.01, 0.02, 0.015}, kF64)};
}

TEST(FitMedium, RecoversMediumWithinTenPercentWithLamp) {
  const LampLight light = vehicle_lamp();
  const auto fit = fit_medium(observe_with_lamp(light), default_medium_prior(light.lamps));
  ASSERT_TRUE(fit && fit->medium.lamp);
  const Medium truth = lake_water();
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, truth.beta_d), 0.1);
  EXPECT_LT(worst_relative_error(fit->medium.b_inf, truth.b_inf), 0.2);
  expect_vignetting(fit->vignetting, 0.02);
  // Lamp backscatter is relative to the light at unit range, which differs between the two.
  const LampLight& found = *fit->medium.lamp;
  const Tensor at_one = torch::tensor({{0.25, -0.15, found.unit_range_m}}, kF64);
  const Tensor there = LampSum::irradiance(light.lamps, light.unit_range_m, at_one)
                           .at(truth.beta_d, light.lamps)
                           .value[0];
  EXPECT_LT(worst_relative_error(found.backscatter, light.backscatter * there), 0.2);
}

// At most about two gray levels, below the noise of an observation.
TEST(FitMedium, WeakVeilingLightIsNotBiasedTowardCoastalPrior) {
  const LampLight light = vehicle_lamp();
  Medium water = lake_water();
  water.b_inf = torch::tensor({0.01, 0.012, 0.003}, kF64);
  const Observations s = observe_with_lamp(light, water);
  const auto fit = fit_medium(s, default_medium_prior(light.lamps));
  const auto coastal = fit_medium(s, {.medium = coastal_medium(), .lamps = light.lamps});
  ASSERT_TRUE(fit && coastal);
  const auto off = [&](const MediumFit& f) {
    return (f.medium.b_inf / water.b_inf).log().abs().mean().item<double>();
  };
  EXPECT_LT(off(*fit), 0.25);
  EXPECT_GT(off(*coastal), 2.0 * off(*fit));
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, water.beta_d), 0.1);
}

TEST(FitMedium, RecoversTheBeamOfALampThatTheRigStatesWrongly) {
  LampLight light = vehicle_lamp();
  light.lamps[0].half_beam_rad = 0.6;
  light.lamps[0].edge = 0.7;
  std::vector<Lamp> stated = light.lamps;
  stated[0].half_beam_rad = 0.75;
  stated[0].edge = 0.0;
  const auto fit = fit_medium(observe_with_lamp(light), default_medium_prior(stated));
  ASSERT_TRUE(fit && fit->medium.lamp);
  EXPECT_NEAR(fit->medium.lamp->lamps[0].half_beam_rad, 0.6, 0.03);
  EXPECT_NEAR(fit->medium.lamp->lamps[0].edge, 0.7, 0.1);
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, lake_water().beta_d), 0.1);
}

TEST(FitMedium, FindsTheSameWaterFromAFarStart) {
  const LampLight light = vehicle_lamp();
  Medium water = lake_water();
  water.beta_d = 4.0 * water.beta_d;
  const Observations s = observe_with_lamp(light, water);
  const auto fit = fit_medium(s, default_medium_prior(light.lamps));
  ASSERT_TRUE(fit);
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, water.beta_d), 0.1);
}

/// Two lamps far to the sides that are aimed inward, one brighter than the other.
LampLight vehicle_lamps() {
  LampLight light = vehicle_lamp();
  light.lamps = {{.position_m = {0.6, -0.2, 0.0},
                  .axis = {-0.28, 0.0, 0.96},
                  .half_beam_rad = 0.6,
                  .share = 0.6},
                 {.position_m = {-0.6, -0.2, 0.0},
                  .axis = {0.28, 0.0, 0.96},
                  .half_beam_rad = 0.6,
                  .share = 0.4}};
  return light;
}

TEST(FitMedium, RecoversMediumWithinTenPercentWithTwoLamps) {
  const LampLight light = vehicle_lamps();
  const Observations s = observe_with_lamp(light);
  const auto fit = fit_medium(s, default_medium_prior(light.lamps));
  ASSERT_TRUE(fit && fit->medium.lamp);
  EXPECT_EQ(fit->medium.lamp->lamps.size(), 2U);
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, lake_water().beta_d), 0.1);
  const auto one = fit_medium(s, default_medium_prior({light.lamps[0]}));
  ASSERT_TRUE(one);
  EXPECT_GT(one->deviance, fit->deviance + 100.0);
}

TEST(FitMedium, AttenuationIsWrongWhenLampIsNotModeled) {
  const auto fit = fit_medium(observe_with_lamp(vehicle_lamp()), default_medium_prior());
  ASSERT_TRUE(fit);
  EXPECT_GT(worst_relative_error(fit->medium.beta_d, lake_water().beta_d), 1.0);
}

TEST(FitMedium, KeepsPriorWhenAllRangesAreEqual) {
  const Observations images = observe(2.0, 2.0);
  MediumPrior weak = default_medium_prior();
  weak.medium.b_inf = 0.1 * weak.medium.b_inf;  // darker than the darkest surface
  const auto fit = fit_medium(images, weak);
  ASSERT_TRUE(fit);
  const Medium prior = weak.medium;
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, prior.beta_d), 0.02);
  const double ratio = std::exp(default_medium_prior().log_ratio);
  EXPECT_LT(worst_relative_error(fit->medium.beta_b, ratio * prior.beta_d), 0.02);
  const Tensor b_inf = prior.b_inf * images.colors.mean() / 0.4;
  EXPECT_LT(worst_relative_error(fit->medium.b_inf, b_inf), 0.02);
  EXPECT_LT(fit->resolution.abs().max().item<double>(), 0.05);
  // Gains and vignetting are still observable.
  expect_vignetting(fit->vignetting, 0.01);
  EXPECT_LT((fit->log_gains - true_log_gains()).abs().max().item<double>(), 0.01);
}

TEST(FitMedium, BackscatterIsNotBrighterThanBlackSurfaces) {
  const double range_m = 2.0;
  Observations s = observe(range_m, range_m);
  const Medium water = lake_water();
  const Tensor scattered = 0.7 * water.b_inf * (1.0 - torch::exp(-water.beta_b * range_m));
  const Tensor gains = true_log_gains().exp().index_select(0, s.views);
  const Tensor black = (s.points % 2 == 0).unsqueeze(1);  // half of the surfaces
  const Tensor response = (gains * kVignetting.factor(s.corners2)).unsqueeze(1);
  s.colors = torch::where(black, scattered * response, s.colors);
  MediumPrior prior = default_medium_prior();
  prior.b_inf_sigma = 3.0;  // at one range, only the black surfaces tell
  const auto fit = fit_medium(s, prior);
  ASSERT_TRUE(fit);
  const Tensor found = fit->medium.b_inf * (1.0 - torch::exp(-fit->medium.beta_b * range_m));
  EXPECT_LT((found / scattered).max().item<double>(), 1.2);
}

TEST(FitMedium, ReportsLargeUncertaintyWhenRangesHardlyVary) {
  const auto narrow = fit_medium(observe(2.0, 2.3), default_medium_prior());
  const auto varied = fit_medium(observe(1.5, 5.0), default_medium_prior());
  ASSERT_TRUE(narrow && varied);
  EXPECT_GT(narrow->sigmas.select(1, 2).min().item<double>(),
            2.0 * varied->sigmas.select(1, 2).max().item<double>());
}

TEST(FitMedium, IsRobustToTenPercentOutliers) {
  Observations s = observe(1.5, 5.0);
  const Tensor wrong = torch::rand({s.ranges.size(0)}, kF64) < 0.1;
  s.colors.index_put_({wrong}, torch::rand({wrong.sum().item<std::int64_t>(), 3}, kF64));
  const auto fit = fit_medium(s, default_medium_prior());
  ASSERT_TRUE(fit);
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, lake_water().beta_d), 0.15);
  EXPECT_LT(worst_relative_error(fit->medium.b_inf, 0.7 * lake_water().b_inf), 0.4);
}

/// Auto-exposure bias: brightness falls with range.
Observations see_darker_with_distance(double by_m) {
  Observations s = observe(1.5, 5.0);
  s.colors = s.colors * torch::exp(-by_m * s.ranges).unsqueeze(1);
  return s;
}

double worst_beta_error(const MediumFit& fit) {
  return worst_relative_error(fit.medium.beta_d, lake_water().beta_d);
}

TEST(FitMedium, FusionAveragesIndependentBiases) {
  MediumPrior prior = default_medium_prior();
  double together = 0.0;
  for (const double by_m : {0.04, -0.03, 0.02, -0.04, 0.03, -0.02}) {
    const Observations s = see_darker_with_distance(by_m);
    const auto alone = fit_medium(s, default_medium_prior());
    const auto fit = fit_medium(s, prior);
    ASSERT_TRUE(alone && fit);
    EXPECT_GT(worst_beta_error(*alone), 0.15);
    together = worst_beta_error(*fit);
    prior.posterior = fit->posterior;
  }
  EXPECT_LT(together, 0.1);
}

TEST(FitMedium, LaterFitsHaveHigherWeight) {
  MediumPrior prior = default_medium_prior();
  std::vector<double> errors;
  for (int i = 0; i < 10; ++i) {
    const auto fit = fit_medium(see_darker_with_distance(i < 3 ? 0.06 : 0.0), prior);
    ASSERT_TRUE(fit);
    prior.posterior = fit->posterior;
    errors.push_back(worst_beta_error(*fit));
  }
  EXPECT_GT(errors[2], 0.4);
  EXPECT_LT(errors[9], 0.15);
}

TEST(FitMedium, ConsistentFitsReduceUncertainty) {
  MediumPrior prior = default_medium_prior();
  const auto first = fit_medium(observe(1.5, 5.0), prior);
  prior.posterior = first->posterior;
  const auto second = fit_medium(observe(1.5, 5.0), prior);
  prior.posterior = second->posterior;
  const auto third = fit_medium(observe(1.5, 5.0), prior);
  ASSERT_TRUE(first && second && third);
  EXPECT_TRUE((third->sigmas < second->sigmas).all().item<bool>());
  EXPECT_LT(worst_relative_error(third->medium.beta_d, lake_water().beta_d), 0.1);
  EXPECT_LT(worst_relative_error(third->medium.b_inf, 0.7 * lake_water().b_inf), 0.15);
  EXPECT_GT(third->resolution.select(1, 0).select(1, 0).min().item<double>(), 0.95);
}

TEST(FitMedium, ReturnsNothingWithTooFewObservations) {
  Observations s = observe(1.5, 5.0);
  for (Tensor* t : {&s.points, &s.views, &s.ranges, &s.corners2, &s.colors, &s.texture}) {
    *t = t->slice(0, 0, 50);
  }
  EXPECT_FALSE(fit_medium(s, default_medium_prior()));
  EXPECT_FALSE(fit_medium({}, default_medium_prior()));
}

}  // namespace
}  // namespace apvi::medium
