// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/appearance/display_exposure.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cstddef>
#include <vector>

#include "mapping/medium/sea_bed.hpp"

namespace apvi::mapping {
namespace {

std::vector<gaussians::View> views_of(const KeyframeStore& keyframes) {
  std::vector<gaussians::View> views;
  for (std::size_t i = 0; i < keyframes.size(); ++i) views.push_back(keyframes.view(i, 1));
  return views;
}

// The sea bed with its colors multiplied by `factor` [3].
Map tinted(const Tensor& factor) {
  Map map = {.gaussians = sea_bed(), .medium = true_water()};
  const Tensor color = gaussians::sh_dc_to_color(map.gaussians.sh_dc);
  map.gaussians.sh_dc = gaussians::color_to_sh_dc(color * factor);
  return map;
}

TEST(DisplayExposure, BrightAndTintedMapsLookLikeTheOriginal) {
  const std::vector<gaussians::View> views = views_of(dive());
  const Map plain = tinted(torch::ones({3}));
  const Map bright = tinted(torch::tensor({3.0F, 4.5F, 4.0F}));
  const Tensor expected =
      displayed(render_map(plain, views[3]).restored, display_exposure(plain, views), {});
  const Tensor image =
      displayed(render_map(bright, views[3]).restored, display_exposure(bright, views), {});
  EXPECT_LT((image - expected).abs().max().item<double>(), 0.01);
}

TEST(DisplayExposure, LessThanOnePercentOfThePixelsAreSaturated) {
  const std::vector<gaussians::View> views = views_of(dive());
  const Map map = tinted(torch::full({3}, 20.0F));
  const DisplayExposure exposure = display_exposure(map, views);
  double saturated = 0.0;
  for (const gaussians::View& view : views) {
    const Tensor image = displayed(render_map(map, view).restored, exposure, {});
    saturated += (image * 255.0 + 0.5 >= 255.0).any(2).to(torch::kFloat64).mean().item<double>();
  }
  EXPECT_LT(saturated / static_cast<double>(views.size()), 0.01);
}

TEST(DisplayExposure, BalanceChangesAChannelByTwoAtMost) {
  const std::vector<gaussians::View> views = views_of(dive());
  const DisplayExposure exposure =
      display_exposure(tinted(torch::tensor({1.0F, 0.01F, 1.0F})), views);
  EXPECT_DOUBLE_EQ(exposure.balance[1], 2.0);
  const DisplayExposure unbalanced =
      display_exposure(tinted(torch::tensor({1.0F, 0.5F, 1.0F})), views, false);
  EXPECT_DOUBLE_EQ(unbalanced.balance[1], 1.0);
}

TEST(DisplayExposure, WithoutSurfacesNothingChanges) {
  const Map empty = {.gaussians = {.means = torch::zeros({0, 3}),
                                   .log_scales = torch::zeros({0, 3}),
                                   .quaternions = torch::zeros({0, 4}),
                                   .logit_opacities = torch::zeros({0}),
                                   .sh_dc = torch::zeros({0, 3}),
                                   .sh_rest = torch::zeros({0, 0, 3})},
                     .medium = true_water()};
  const DisplayExposure exposure = display_exposure(empty, views_of(dive()));
  EXPECT_DOUBLE_EQ(exposure.gains()[0], 1.0);
}

TEST(DisplayExposure, HighlightsAreCompressedMonotonically) {
  const Tensor ramp = torch::linspace(0.0, 3.0, 301).reshape({1, 301, 1}).repeat({1, 1, 3});
  const Tensor image = displayed(ramp, {}, {}).select(2, 0).squeeze(0);
  EXPECT_TRUE(torch::allclose(image.slice(0, 0, 80), ramp.select(2, 0).squeeze(0).slice(0, 0, 80)));
  EXPECT_TRUE((image.slice(0, 1) > image.slice(0, 0, -1)).all().item<bool>());
  EXPECT_LE(image.max().item<double>(), 1.0);
}

}  // namespace
}  // namespace apvi::mapping
