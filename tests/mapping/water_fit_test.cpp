// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/water_fit.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <vector>

#include "apvi/splat/lamp.hpp"
#include "apvi/splat/medium_estimate.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kPoints = 400;
constexpr std::int64_t kViews = 12;
constexpr double kVignetting = 0.25;
const auto kF64 = torch::dtype(torch::kFloat64);

splat::Medium water_of_a_lake() {
  return {.beta_d = torch::tensor({0.28, 0.11, 0.14}, kF64),
          .beta_b = torch::tensor({0.275, 0.105, 0.13}, kF64),
          .b_inf = torch::tensor({0.03, 0.12, 0.11}, kF64)};
}

Tensor true_log_gains() {
  return torch::linspace(-0.3, 0.3, kViews, kF64);
}

/// Every point in half of the views, from `nearest` to `farthest` metres.
Sightings see(double nearest, double farthest, double noise = 0.005) {
  torch::manual_seed(7);
  const splat::Medium water = water_of_a_lake();
  const Tensor colors = 0.05 + 0.8 * torch::rand({kPoints, 3}, kF64);
  const Tensor all = torch::rand({kPoints, kViews}, kF64) < 0.5;
  const Tensor pairs = all.nonzero();
  Sightings s;
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
      true_log_gains().exp().index_select(0, s.views) * (1.0 - kVignetting * s.corners2);
  s.colors = 0.7 * seen * response.unsqueeze(1) + noise * torch::randn({n, 3}, kF64);
  s.point_count = kPoints;
  s.view_count = kViews;
  return s;
}

double worst_relative_error(const Tensor& got, const Tensor& truth) {
  return ((got - truth).abs() / truth).max().item<double>();
}

TEST(FitWater, FindsTheWaterWithinATenthWhenDistancesVary) {
  const auto fit = fit_water(see(1.5, 5.0), usual_prior());
  ASSERT_TRUE(fit);
  const splat::Medium truth = water_of_a_lake();
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, truth.beta_d), 0.1);
  EXPECT_LT(worst_relative_error(fit->medium.beta_b, truth.beta_b), 0.15);
  // All light 0.7 times as bright: the veil too.
  EXPECT_LT(worst_relative_error(fit->medium.b_inf, 0.7 * truth.b_inf), 0.15);
  EXPECT_NEAR(fit->vignetting, kVignetting, 0.01);
  EXPECT_LT((fit->log_gains - true_log_gains()).abs().max().item<double>(), 0.01);
  EXPECT_GT(fit->known.select(1, 0).select(1, 0).min().item<double>(), 0.95);
}

TEST(FitWater, DoesNotMindTheOrderOfTheSightings) {
  const Sightings s = see(1.5, 5.0);
  Sightings shuffled = s;
  const Tensor order = torch::randperm(s.ranges.size(0), torch::kInt64);
  for (Tensor Sightings::*part : {&Sightings::points, &Sightings::views, &Sightings::ranges,
                                  &Sightings::corners2, &Sightings::colors, &Sightings::texture}) {
    shuffled.*part = (s.*part).index_select(0, order);
  }
  const auto a = fit_water(s, usual_prior());
  const auto b = fit_water(shuffled, usual_prior());
  ASSERT_TRUE(a && b);
  EXPECT_LT(worst_relative_error(b->medium.beta_d, a->medium.beta_d), 1e-6);
  EXPECT_LT(worst_relative_error(b->sigmas, a->sigmas), 1e-6);
  EXPECT_LT((b->log_gains - a->log_gains).abs().max().item<double>(), 1e-6);
}

// The spread of what forty draws of the noise lead to, by the fit's own account of it: errors of
// neighbouring sightings are taken to be alike, which these are not, so it claims 1.8 times as
// much.
TEST(FitWater, KnowsHowFarItIsOff) {
  std::vector<Tensor> found;
  Tensor claimed = torch::zeros({3}, kF64);
  Sightings s = see(1.5, 5.0, 0.0);
  const Tensor colors = s.colors;
  constexpr int kDraws = 40;
  for (int i = 0; i < kDraws; ++i) {
    s.colors = colors + 0.02 * torch::randn(colors.sizes(), kF64);
    const auto fit = fit_water(s, usual_prior());
    ASSERT_TRUE(fit);
    found.push_back(fit->medium.beta_d.log());
    claimed += fit->sigmas.select(1, 0) / kDraws;
  }
  const Tensor ratio = claimed / torch::stack(found).std(0);
  EXPECT_GT(ratio.min().item<double>(), 1.2) << ratio;
  EXPECT_LT(ratio.max().item<double>(), 2.8) << ratio;
}

/// Sightings of a bed that is lit by a lamp beside the camera, and a little daylight.
Sightings see_by_lamplight(const splat::LampLight& light,
                           const splat::Medium& water = water_of_a_lake()) {
  Sightings s = see(1.0, 3.5);
  const std::int64_t n = s.ranges.size(0);
  const Tensor across = 0.5 * torch::randn({n, 2}, kF64);
  const Tensor ahead = torch::cat({across, torch::ones({n, 1}, kF64)}, 1);
  const Tensor rays = ahead / ahead.norm(2, 1, true);
  s.places = rays * s.ranges.unsqueeze(1);
  const Tensor tilt = torch::randn({n, 3}, kF64) * 0.2 + torch::tensor({0.0, 0.0, -1.0}, kF64);
  s.normals = tilt / tilt.norm(2, 1, true);
  const Tensor position = torch::tensor(
      {light.lamp.position_m[0], light.lamp.position_m[1], light.lamp.position_m[2]}, kF64);
  const Tensor from = s.places - position;
  const Tensor facing = ((from * s.normals).sum(1, true) / from.norm(2, 1, true)).abs();
  const Tensor shine =
      splat::lamp_shine(light.lamp, light.unit_range_m, water.beta_d, s.places).value;
  const Tensor haze =
      splat::lamp_haze(light.lamp, light.unit_range_m, water.beta_d, rays, s.ranges).value;
  const Tensor z = s.ranges.unsqueeze(1);
  const Tensor colors = 0.05 + 0.8 * torch::rand({kPoints, 3}, kF64);
  const Tensor direct = colors.index_select(0, s.points) *
                        (light.daylight + (1.0 - light.daylight) * facing * shine) *
                        torch::exp(-water.beta_d * z);
  const Tensor seen =
      direct + water.b_inf * (1.0 - torch::exp(-water.beta_b * z)) + light.glow * haze;
  const Tensor response =
      true_log_gains().exp().index_select(0, s.views) * (1.0 - kVignetting * s.corners2);
  s.colors = seen * response.unsqueeze(1) + 0.003 * torch::randn({n, 3}, kF64);
  return s;
}

splat::LampLight lamp_of_a_vehicle() {
  return {.lamp = {.position_m = {0.25, -0.15, 0.0}},
          .unit_range_m = 2.0,
          .daylight = torch::tensor({0.05, 0.2, 0.1}, kF64),
          .glow = torch::tensor({0.01, 0.02, 0.015}, kF64)};
}

TEST(FitWater, FindsTheWaterWithinATenthByLamplight) {
  const splat::LampLight light = lamp_of_a_vehicle();
  const auto fit = fit_water(see_by_lamplight(light), usual_prior(light.lamp));
  ASSERT_TRUE(fit && fit->medium.lamp);
  const splat::Medium truth = water_of_a_lake();
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, truth.beta_d), 0.1);
  EXPECT_LT(worst_relative_error(fit->medium.b_inf, truth.b_inf), 0.2);
  EXPECT_NEAR(fit->vignetting, kVignetting, 0.02);
  // The glow over the light where that counts as one, which is another place here and there.
  const splat::LampLight& found = *fit->medium.lamp;
  const Tensor at_one = torch::tensor({{0.25, -0.15, found.unit_range_m}}, kF64);
  const Tensor there =
      splat::lamp_shine(light.lamp, light.unit_range_m, truth.beta_d, at_one).value[0];
  EXPECT_LT(worst_relative_error(found.glow, light.glow * there), 0.2);
}

// Of some two bytes where it is brightest, which is less than a sighting's noise.
TEST(FitWater, AVeilThatIsHardlyThereIsNotHeldUpByWhatIsUsualAtTheCoast) {
  const splat::LampLight light = lamp_of_a_vehicle();
  splat::Medium water = water_of_a_lake();
  water.b_inf = torch::tensor({0.01, 0.012, 0.003}, kF64);
  const Sightings s = see_by_lamplight(light, water);
  const auto fit = fit_water(s, usual_prior(light.lamp));
  const auto coastal = fit_water(s, {.medium = splat::coastal_medium(), .lamp = light.lamp});
  ASSERT_TRUE(fit && coastal);
  const auto off = [&](const WaterFit& f) {
    return (f.medium.b_inf / water.b_inf).log().abs().mean().item<double>();
  };
  EXPECT_LT(off(*fit), 0.25);
  EXPECT_GT(off(*coastal), 2.0 * off(*fit));
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, water.beta_d), 0.1);
}

TEST(FitWater, TakesLamplightForMurkWhenNobodyTellsOfTheLamp) {
  const auto fit = fit_water(see_by_lamplight(lamp_of_a_vehicle()), usual_prior());
  ASSERT_TRUE(fit);
  EXPECT_GT(worst_relative_error(fit->medium.beta_d, water_of_a_lake().beta_d), 1.0);
}

TEST(FitWater, WaterStaysAtItsPriorWhileAllIsAtOneDistance) {
  const auto fit = fit_water(see(2.0, 2.0), usual_prior());
  ASSERT_TRUE(fit);
  const splat::Medium prior = splat::coastal_medium();
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, prior.beta_d), 0.02);
  const double ratio = std::exp(usual_prior().log_ratio);
  EXPECT_LT(worst_relative_error(fit->medium.beta_b, ratio * prior.beta_d), 0.02);
  EXPECT_LT(worst_relative_error(fit->medium.b_inf, prior.b_inf), 0.02);
  EXPECT_LT(fit->known.abs().max().item<double>(), 0.05);
  // The camera is known all the same.
  EXPECT_NEAR(fit->vignetting, kVignetting, 0.01);
  EXPECT_LT((fit->log_gains - true_log_gains()).abs().max().item<double>(), 0.01);
}

TEST(FitWater, SaysHowLittleItKnowsWhenDistancesHardlyVary) {
  const auto near_alike = fit_water(see(2.0, 2.3), usual_prior());
  const auto varied = fit_water(see(1.5, 5.0), usual_prior());
  ASSERT_TRUE(near_alike && varied);
  EXPECT_GT(near_alike->sigmas.select(1, 2).min().item<double>(),
            2.0 * varied->sigmas.select(1, 2).max().item<double>());
}

TEST(FitWater, BearsThatATenthOfTheSightingsAreOfSomethingElse) {
  Sightings s = see(1.5, 5.0);
  const Tensor wrong = torch::rand({s.ranges.size(0)}, kF64) < 0.1;
  s.colors.index_put_({wrong}, torch::rand({wrong.sum().item<std::int64_t>(), 3}, kF64));
  const auto fit = fit_water(s, usual_prior());
  ASSERT_TRUE(fit);
  EXPECT_LT(worst_relative_error(fit->medium.beta_d, water_of_a_lake().beta_d), 0.15);
  EXPECT_LT(worst_relative_error(fit->medium.b_inf, 0.7 * water_of_a_lake().b_inf), 0.4);
}

/// What a camera does that exposes by what is before it: all is the darker the farther it is.
Sightings see_darker_with_distance(double by_m) {
  Sightings s = see(1.5, 5.0);
  s.colors = s.colors * torch::exp(-by_m * s.ranges).unsqueeze(1);
  return s;
}

double worst_beta_error(const WaterFit& fit) {
  return worst_relative_error(fit.medium.beta_d, water_of_a_lake().beta_d);
}

TEST(FitWater, SurveysThatAreEachOffInTheirOwnWayAreRightTogether) {
  WaterPrior prior = usual_prior();
  double together = 0.0;
  for (const double by_m : {0.04, -0.03, 0.02, -0.04, 0.03, -0.02}) {
    const Sightings s = see_darker_with_distance(by_m);
    const auto alone = fit_water(s, usual_prior());
    const auto fit = fit_water(s, prior);
    ASSERT_TRUE(alone && fit);
    EXPECT_GT(worst_beta_error(*alone), 0.15);
    together = worst_beta_error(*fit);
    prior.surveys = fit->surveys;
  }
  EXPECT_LT(together, 0.1);
}

TEST(FitWater, ALaterSurveyCountsForMoreThanAnEarlierOne) {
  WaterPrior prior = usual_prior();
  std::vector<double> errors;
  for (int i = 0; i < 10; ++i) {
    const auto fit = fit_water(see_darker_with_distance(i < 3 ? 0.06 : 0.0), prior);
    ASSERT_TRUE(fit);
    prior.surveys = fit->surveys;
    errors.push_back(worst_beta_error(*fit));
  }
  EXPECT_GT(errors[2], 0.4);
  EXPECT_LT(errors[9], 0.15);
}

TEST(FitWater, SurveysThatAgreeMakeWaterBetterKnown) {
  WaterPrior prior = usual_prior();
  const auto first = fit_water(see(1.5, 5.0), prior);
  prior.surveys = first->surveys;
  const auto second = fit_water(see(1.5, 5.0), prior);
  prior.surveys = second->surveys;
  const auto third = fit_water(see(1.5, 5.0), prior);
  ASSERT_TRUE(first && second && third);
  EXPECT_TRUE((third->sigmas < second->sigmas).all().item<bool>());
  EXPECT_LT(worst_relative_error(third->medium.beta_d, water_of_a_lake().beta_d), 0.1);
  EXPECT_LT(worst_relative_error(third->medium.b_inf, 0.7 * water_of_a_lake().b_inf), 0.15);
  EXPECT_GT(third->known.select(1, 0).select(1, 0).min().item<double>(), 0.95);
}

TEST(FitWater, AFewSightingsAreNone) {
  Sightings s = see(1.5, 5.0);
  for (Tensor* t : {&s.points, &s.views, &s.ranges, &s.corners2, &s.colors, &s.texture}) {
    *t = t->slice(0, 0, 50);
  }
  EXPECT_FALSE(fit_water(s, usual_prior()));
  EXPECT_FALSE(fit_water({}, usual_prior()));
}

}  // namespace
}  // namespace apvi::mapping
