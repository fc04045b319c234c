// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/medium_estimation.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <set>
#include <vector>

#include "gaussians/render/render.hpp"
#include "map_io/ply.hpp"
#include "mapping/appearance/view_gains.hpp"
#include "mapping/density/seeds.hpp"
#include "mapping/medium/sea_bed.hpp"
#include "medium/lamp.hpp"
#include "medium/medium_initialization.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

double worst_relative_error(const Tensor& got, const Tensor& truth) {
  return ((got - truth).abs() / truth).max().item<double>();
}

TEST(EstimateMedium, RecoversMediumAndCameraFromMapAndKeyframes) {
  const gaussians::Gaussians bed = sea_bed();
  const KeyframeStore keyframes = dive();
  const auto estimation = estimate_medium({.gaussians = bed, .medium = std::nullopt}, keyframes,
                                          0.1, {.medium = medium::coastal_medium()}, 1);
  ASSERT_TRUE(estimation);
  EXPECT_EQ(estimation->views.size(), 14U);
  EXPECT_LT(worst_relative_error(estimation->fit.medium.beta_d, true_water().beta_d), 0.05);
  EXPECT_LT(worst_relative_error(estimation->fit.medium.beta_b, true_water().beta_b), 0.15);
  EXPECT_LT(worst_relative_error(estimation->fit.medium.b_inf, true_water().b_inf), 0.12);
  const Tensor s = torch::linspace(0.1, 1.0, 10, torch::kFloat64);
  EXPECT_LT(
      (estimation->fit.vignetting.factor(s) - kVignetting.factor(s)).abs().max().item<double>(),
      0.01);
  double mean = 0.0;
  for (int i = 0; i < 14; ++i) mean += log_gain_of(i) / 14.0;
  for (int i = 0; i < 14; ++i) {
    EXPECT_NEAR(estimation->fit.log_gains[i].item<double>(), log_gain_of(i) - mean, 0.03) << i;
  }
}

TEST(EstimateMedium, OpenWaterConstrainsVeilingLight) {
  const auto estimation =
      estimate_medium({.gaussians = sea_bed(), .medium = std::nullopt}, dive(kAhead), 0.1,
                      {.medium = medium::coastal_medium()}, 1);
  ASSERT_TRUE(estimation);
  EXPECT_TRUE(estimation->sees_open_water);
  EXPECT_LT(worst_relative_error(estimation->fit.medium.b_inf, true_water().b_inf), 0.03);
  EXPECT_LT(worst_relative_error(estimation->fit.medium.beta_d, true_water().beta_d), 0.05);
}

std::optional<MediumEstimation> estimate_with_unknown_curve(const KeyframeStore& keyframes) {
  return estimate_medium({.gaussians = sea_bed(), .medium = std::nullopt}, keyframes, 0.1,
                         {.medium = medium::coastal_medium()}, 1, {},
                         ToneCurveEvidence(ToneCurveOptions{}));
}

TEST(EstimateMedium, FindsTheWaterOfACameraForViewing) {
  const auto estimation = estimate_with_unknown_curve(dive(kDownwards, {}, 14, {.gamma = 2.2}));
  ASSERT_TRUE(estimation);
  EXPECT_EQ(estimation->tone_curve, kViewingCurve);
  EXPECT_LT(worst_relative_error(estimation->fit.medium.beta_d, true_water().beta_d), 0.05);
  EXPECT_LT(worst_relative_error(estimation->fit.medium.b_inf, true_water().b_inf), 0.12);
}

TEST(EstimateMedium, RecognizesALinearCamera) {
  const auto estimation = estimate_with_unknown_curve(dive());
  ASSERT_TRUE(estimation);
  EXPECT_TRUE(estimation->tone_curve.is_linear());
  EXPECT_LT(worst_relative_error(estimation->fit.medium.beta_d, true_water().beta_d), 0.05);
}

/// The same dive in a world with z up instead of y down.
KeyframeStore upright(const KeyframeStore& keyframes) {
  const Tensor to_old = torch::tensor({1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0,
                                       0.0, 0.0, 0.0, 1.0},
                                      torch::kFloat64)
                            .reshape({4, 4});
  KeyframeStore store;
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    Keyframe keyframe = keyframes[i];
    keyframe.T_camera_world = keyframe.T_camera_world.mm(to_old);
    store.add(std::move(keyframe));
  }
  return store;
}

gaussians::Gaussians upright(gaussians::Gaussians map) {
  map.means =
      torch::stack({map.means.select(1, 0), map.means.select(1, 2), -map.means.select(1, 1)}, 1);
  const float half = std::sqrt(0.5F);
  map.quaternions = torch::tensor({half, -half, 0.0F, 0.0F}).repeat({map.size(), 1});
  return map;
}

// Before the medium is estimated, an early map represents open water by Gaussians of its color.
// Only distant low-visibility sand is uncovered, whose color differs from the water.
TEST(EstimateMedium, UsesOpenWaterAboveHorizonCoveredByMap) {
  const torch::NoGradGuard no_grad;
  gaussians::Gaussians map = sea_bed();
  const std::int64_t n = 4000;
  torch::manual_seed(5);
  const Tensor across = 24.0 * torch::rand({n}) - 12.0;
  const Tensor down = 12.0 * torch::rand({n}) - 10.0;
  const gaussians::Gaussians painted = {
      .means = torch::stack({across, down, torch::full({n}, 13.0)}, 1),
      .log_scales = torch::full({n, 3}, std::log(0.3F)),
      .quaternions = map.quaternions.slice(0, 0, n),
      .logit_opacities = torch::full({n}, 4.0F),
      .sh_dc = gaussians::color_to_sh_dc(true_water().b_inf.expand({n, 3})),
      .sh_rest = torch::zeros({n, 0, 3})};
  for (std::size_t k = 0; k < map.tensors().size(); ++k) {
    *map.tensors()[k] = torch::cat({*map.tensors()[k], *painted.tensors()[k]});
  }
  const auto estimation =
      estimate_medium({.gaussians = upright(map), .medium = std::nullopt}, upright(dive(kAhead)),
                      0.1, {.medium = medium::coastal_medium()}, 1);
  ASSERT_TRUE(estimation);
  EXPECT_TRUE(estimation->sees_open_water);
  EXPECT_LT(worst_relative_error(estimation->fit.medium.b_inf, true_water().b_inf), 0.03);
}

TEST(EstimateMedium, UnmappedSurfacesAreNotOpenWater) {
  gaussians::Gaussians bed = sea_bed();
  const Tensor known = (bed.means.select(1, 0) < 0.5).nonzero().squeeze(1);
  for (Tensor* part : bed.tensors()) *part = part->index_select(0, known);
  const auto estimation = estimate_medium({.gaussians = bed, .medium = std::nullopt}, dive(), 0.1,
                                          {.medium = medium::coastal_medium()}, 1);
  ASSERT_TRUE(estimation);
  EXPECT_FALSE(estimation->sees_open_water);
  EXPECT_LT(worst_relative_error(estimation->fit.medium.beta_d, true_water().beta_d), 0.1);
}

TEST(EstimateMedium, WithLampUsesDepthFromImagesInsteadOfBiasedMap) {
  const medium::Lamp lamp = {
      .position_m = {0.0, 0.0, 0.0}, .axis = {0.0, 0.0, 1.0}, .half_beam_rad = 1.0};
  const KeyframeStore keyframes = dive(kDownwards, lamp, 36);
  Map map = {.gaussians = sea_bed(), .medium = std::nullopt};
  map.gaussians.means.select(1, 1) -= 0.2;  // about two meters away
  const medium::MediumPrior prior = {.medium = medium::coastal_medium(), .lamps = {lamp}};
  const auto error = [&](const depth::DepthOptions& depth) {
    const auto estimation = estimate_medium(map, keyframes, 0.1, prior, 1, depth);
    return estimation ? worst_relative_error(estimation->fit.medium.beta_d, true_water().beta_d)
                      : 10.0;
  };
  depth::DepthOptions blind;
  blind.views = 1;  // only the map's depth
  const double by_map = error(blind);
  const double by_images = error({});
  EXPECT_GT(by_map, 2.0 * by_images);
  EXPECT_LT(by_images, 0.25) << by_map;
}

// Gains of the newest keyframes are not yet estimated.
TEST(EstimateMedium, UsesNewestKeyframesAndRandomOthers) {
  const gaussians::Gaussians bed = sea_bed();
  const KeyframeStore keyframes = dive(kDownwards, {}, 60);
  std::set<std::vector<std::size_t>> different;
  for (const std::uint64_t seed : {1, 2, 3}) {
    const auto estimation = estimate_medium({.gaussians = bed, .medium = std::nullopt}, keyframes,
                                            0.01, {.medium = medium::coastal_medium()}, seed);
    ASSERT_TRUE(estimation);
    ASSERT_EQ(estimation->views.size(), 33U);
    EXPECT_EQ(estimation->views[22], 49U);
    EXPECT_EQ(estimation->views.back(), 59U);
    different.insert(estimation->views);
  }
  EXPECT_EQ(different.size(), 3U);
}

TEST(EstimateMedium, ReturnsNothingForEmptyMapOrSingleView) {
  const gaussians::Gaussians bed = sea_bed();
  const KeyframeStore keyframes = dive();
  const medium::MediumPrior prior = {.medium = medium::coastal_medium()};
  EXPECT_FALSE(estimate_medium(
      {.gaussians = gaussians::Gaussians::empty(0, torch::kFloat32), .medium = std::nullopt},
      keyframes, 0.1, prior, 1));
  EXPECT_FALSE(
      estimate_medium({.gaussians = bed, .medium = std::nullopt}, keyframes, 100.0, prior, 1));
  EXPECT_FALSE(
      estimate_medium({.gaussians = bed, .medium = std::nullopt}, KeyframeStore(), 0.1, prior, 1));
}

}  // namespace
}  // namespace apvi::mapping
