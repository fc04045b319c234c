// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/densify.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

#include "support/posed_scene.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using test::tensors_near;
using torch::Tensor;

constexpr double kExtent = 1.0;

DensifyOptions options() {
  return {.gradient_threshold = 0.5,
          .split_scale = 0.2,
          .prune_opacity = 0.005,
          .prune_weight = 0.01,
          .prune_scale = 0.9};
}

/// Statistics of two identical views.
DensityStatistics statistics(const Tensor& gradient, const Tensor& weight) {
  DensityStatistics result(gradient.size(0));
  for (int i = 0; i < 2; ++i) {
    result.observe({.visible = torch::ones({gradient.size(0)}, torch::kBool),
                    .radii_px = torch::ones_like(gradient),
                    .max_weight = weight,
                    .mean2d_gradient = gradient});
  }
  return result;
}

DensifyResult grow(gaussians::GaussianStore& store, DensityStatistics statistics,
                   std::int64_t limit) {
  return densify(store, statistics, options(), kExtent, limit, 0);
}

gaussians::Gaussians three() {
  gaussians::Gaussians map = test::gaussian_wall(3);
  map.log_scales[1].fill_(std::log(0.5F));
  return map;
}

TEST(Densify, ClonesSmallGaussiansAndSplitsLargeOnes) {
  const gaussians::Gaussians map = three();
  gaussians::GaussianStore store(map);
  const DensifyResult result =
      grow(store, statistics(torch::tensor({0.6F, 0.6F, 0.1F}), torch::ones({3})), 100);
  EXPECT_EQ(result.cloned, 1);
  EXPECT_EQ(result.split, 1);
  ASSERT_EQ(store.size(), 5);  // 0, 2, the clone of 0, the children of 1
  const gaussians::Gaussians& grown = store.view();
  EXPECT_TRUE(torch::equal(grown.means[2], map.means[0]));
  EXPECT_TRUE(torch::equal(grown.means[0], map.means[0]));
  EXPECT_NEAR(grown.log_scales[3][0].item<float>(), std::log(0.5 / 1.6), 1e-6);
  EXPECT_LT((grown.means[3] - map.means[1]).norm().item<float>(), 3.0F);
  EXPECT_FALSE(torch::equal(grown.means[3], grown.means[4]));
}

TEST(Densify, ClonesKeepTheTotalTransmittance) {
  gaussians::GaussianStore store(three());
  grow(store, statistics(torch::tensor({0.6F, 0.1F, 0.1F}), torch::ones({3})), 100);
  const Tensor opacity = store.view().logit_opacities.detach().sigmoid();
  const double one = 1.0 / (1.0 + std::exp(-2.0));
  EXPECT_NEAR(opacity[0].item<float>(), opacity[3].item<float>(), 1e-6);
  EXPECT_NEAR(std::pow(1.0 - opacity[0].item<float>(), 2), 1.0 - one, 1e-5);
}

TEST(Densify, DensifiesTheLargestGradientsFirst) {
  const gaussians::Gaussians map = test::gaussian_wall(10);
  gaussians::GaussianStore store(map);
  const Tensor gradient = torch::arange(1, 11).to(torch::kFloat32);
  grow(store, statistics(gradient, torch::ones({10})), 12);
  ASSERT_EQ(store.size(), 12);
  EXPECT_TRUE(torch::equal(store.view().means.slice(0, 10), map.means.slice(0, 8)));
}

TEST(Densify, PrunesTransparentLargeAndUnusedGaussians) {
  gaussians::Gaussians map = test::gaussian_wall(5);
  map.logit_opacities[0] = -8.0;
  map.log_scales[1][2] = 0.0;
  gaussians::GaussianStore store(map);
  Tensor weight = torch::ones({5});
  weight[2] = 0.001;
  const DensifyResult result = grow(store, statistics(torch::zeros({5}), weight), 100);
  EXPECT_EQ(result.pruned, 3);
  EXPECT_TRUE(torch::equal(store.view().means, map.means.slice(0, 3)));
}

TEST(Densify, KeepsGaussiansSeenOnlyOnce) {
  const gaussians::Gaussians map = test::gaussian_wall(2);
  DensityStatistics seen_once(2);
  seen_once.observe({.visible = torch::ones({2}, torch::kBool),
                     .radii_px = torch::ones({2}),
                     .max_weight = torch::zeros({2}),
                     .mean2d_gradient = torch::zeros({2})});
  EXPECT_FALSE(prune_mask(map, seen_once, options(), kExtent).any().item<bool>());
}

TEST(DensityStatistics, AverageOverViewsThatSeeTheGaussian) {
  DensityStatistics stats(2);
  for (const bool seen : {true, false, true}) {
    stats.observe({.visible = torch::tensor({true, seen}),
                   .radii_px = torch::ones({2}),
                   .max_weight = torch::tensor({0.2F, seen ? 0.5F : 0.0F}),
                   .mean2d_gradient = torch::tensor({3.0F, seen ? 4.0F : 0.0F})});
  }
  EXPECT_TRUE(tensors_near(stats.mean_gradient(), torch::tensor({3.0F, 4.0F}), 1e-6));
  EXPECT_TRUE(tensors_near(stats.max_weight(), torch::tensor({0.2F, 0.5F}), 1e-6));
  stats.extend(1);
  EXPECT_EQ(stats.size(), 3);
  EXPECT_EQ(stats.views()[2].item<float>(), 0.0F);
}

TEST(DensityStatistics, ImportanceIsTheDecayingMaximumWeight) {
  DensityStatistics stats(3);
  const auto see = [&stats](float first, float second) {
    stats.observe({.visible = torch::tensor({true, true, false}),
                   .radii_px = torch::ones({3}),
                   .max_weight = torch::tensor({first, second, 0.0F}),
                   .mean2d_gradient = torch::zeros({3})});
  };
  for (int i = 0; i < 300; ++i) see(0.1F, i == 299 ? 0.8F : 0.1F);
  stats.begin_round();
  EXPECT_TRUE(tensors_near(stats.importance(), torch::tensor({0.1F, 0.8F, 1.0F}), 1e-6));
  EXPECT_EQ(stats.views().sum().item<float>(), 0.0F);
  for (int i = 0; i < 10; ++i) see(0.2F, 0.2F);
  const auto faded = static_cast<float>(0.8 * std::pow(0.98, 10));
  EXPECT_TRUE(tensors_near(stats.importance(), torch::tensor({0.2F, faded, 1.0F}), 1e-5));
  stats.begin_round();  // does not change the importance
  EXPECT_TRUE(tensors_near(stats.importance(), torch::tensor({0.2F, faded, 1.0F}), 1e-5));
}

TEST(DensityStatistics, StayAlignedWithTheGaussiansInDensify) {
  gaussians::Gaussians map = test::gaussian_wall(4);
  map.logit_opacities[0] = -8.0;  // pruned
  gaussians::GaussianStore store(map);
  DensityStatistics stats =
      statistics(torch::tensor({0.0F, 0.1F, 0.6F, 0.1F}), torch::tensor({1.0F, 0.3F, 0.4F, 0.5F}));
  stats.begin_round();
  stats.observe({.visible = torch::ones({4}, torch::kBool),
                 .radii_px = torch::ones({4}),
                 .max_weight = torch::ones({4}),
                 .mean2d_gradient = torch::tensor({0.0F, 0.1F, 0.6F, 0.1F})});
  const Tensor before = stats.importance().clone();
  densify(store, stats, options(), kExtent, 100, 0);
  ASSERT_EQ(store.size(), 4);  // 1, 2, 3, the clone of 2
  ASSERT_EQ(stats.size(), 4);
  EXPECT_TRUE(torch::equal(stats.importance().slice(0, 0, 3), before.slice(0, 1, 4)));
  EXPECT_EQ(stats.importance()[3].item<float>(), 1.0F);
}

}  // namespace
}  // namespace apvi::mapping
