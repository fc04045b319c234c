// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/open_water.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "map_io/ply.hpp"
#include "mapping/training/map_optimizer.hpp"
#include "medium/medium_view.hpp"
#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

const medium::Medium& blue_water() {
  static const medium::Medium medium = {.beta_d = torch::tensor({0.30F, 0.13F, 0.14F}),
                                        .beta_b = torch::tensor({0.26F, 0.09F, 0.10F}),
                                        .b_inf = torch::tensor({0.13F, 0.55F, 0.75F})};
  return medium;
}

double share(const Tensor& mask) {
  return mask.to(torch::kFloat64).mean().item<double>();
}

/// Open water, with sand in the lower half.
Tensor sand_under(const Tensor& water) {
  Tensor image = water + 0.005 * torch::randn(water.sizes());
  image.slice(0, 30).copy_(torch::tensor({0.4F, 0.5F, 0.3F}));
  return image;
}

TEST(OpenWater, IsUniformAndHasColorOfWater) {
  torch::manual_seed(3);
  const Tensor water = blue_water().b_inf.expand({60, 80, 3});
  const Tensor noise = 0.01 * torch::randn({60, 80, 3});
  EXPECT_GT(share(open_water(water + noise, water)), 0.99);
  EXPECT_GT(share(open_water(1.03 * water + noise, water)), 0.99);
  // Surfaces: of another color, or textured around the color of the water.
  EXPECT_LT(share(open_water(water + 0.06 + noise, water)), 0.01);
  EXPECT_LT(share(open_water(water + 0.1 * torch::randn({60, 80, 1}), water)), 0.01);
}

TEST(OpenWater, EndsAtSurface) {
  torch::manual_seed(4);
  const Tensor water = blue_water().b_inf.expand({60, 80, 3});
  const Tensor image = sand_under(water);
  const Tensor open = open_water(image, water);
  EXPECT_EQ(share(open.slice(0, 30)), 0.0);
  EXPECT_GT(share(open.slice(0, 0, 27)), 0.99);
}

TEST(OpacityLossGradient, OpensWaterAndEdgesAndClosesSurfaces) {
  torch::manual_seed(5);
  const Tensor water = blue_water().b_inf.expand({60, 80, 3});
  const Tensor image = sand_under(water);
  const Tensor kinds = classify_water(image, water);
  EXPECT_EQ(share(kinds.slice(0, 30) == -1), 1.0);
  const Tensor alpha = torch::full({60, 80}, 0.25);
  const OpacityWeights weights = {.open = 2.0, .edge = 0.3, .surface = 0.5};
  const Tensor pull = opacity_loss_gradient(image, water, alpha, weights) * 60.0 * 80.0;
  EXPECT_GT(share(pull.slice(0, 0, 27) == 2.0), 0.99);
  EXPECT_EQ(share((pull.slice(0, 28, 31) - 0.3).abs() < 1e-6), 1.0);  // on both sides
  EXPECT_EQ(share((pull.slice(0, 34) + 0.5 * 0.75).abs() < 1e-6), 1.0);
  const Tensor closed = opacity_loss_gradient(image, water, torch::ones_like(alpha), weights);
  EXPECT_EQ(closed.slice(0, 34).abs().max().item<float>(), 0.0F);
}

/// A wall with open water above it, and Gaussians of the color of the water in front of the latter.
struct Fog {
  gaussians::Gaussians world;
  gaussians::Gaussians with_fog;
  KeyframeStore keyframes;
  std::int64_t walls = 0;
};

Fog wall_under_open_water(double exposure) {
  Fog scene;
  scene.world = test::gaussian_wall(600);
  const Tensor low = (scene.world.means.select(1, 1) > 0.0).nonzero().squeeze(1);
  for (Tensor* tensor : scene.world.tensors()) *tensor = tensor->index_select(0, low);
  scene.walls = low.size(0);
  scene.with_fog = scene.world;
  gaussians::Gaussians fog = test::gaussian_wall(200);
  fog.means.select(1, 1).copy_(-0.4 - fog.means.select(1, 1).abs());
  fog.sh_dc.copy_(gaussians::color_to_sh_dc(blue_water().b_inf.expand({200, 3})));
  for (std::size_t k = 0; k < fog.tensors().size(); ++k) {
    *scene.with_fog.tensors()[k] = torch::cat({*scene.world.tensors()[k], *fog.tensors()[k]});
  }
  for (std::int64_t i = 0; i < 6; ++i) {
    Keyframe keyframe = test::render_keyframe(
        scene.world, test::camera_at(0.2 * static_cast<double>(i) - 0.5, 0.0), i);
    const Map map = {.gaussians = scene.world, .medium = blue_water()};
    const MapRendering image = render_map(map, {.intrinsics = keyframe.intrinsics,
                                                .T_camera_world = keyframe.T_camera_world,
                                                .pose_delta = {}});
    keyframe.image = ((exposure * image.color).clamp(0.0, 1.0) * 255.0 + 0.5).to(torch::kUInt8);
    scene.keyframes.add(keyframe);
  }
  return scene;
}

// It looks like a more distant opaque surface, which is too dark without the medium.
TEST(MapOptimizer, MakesTranslucentSurfaceOpaqueInFrontOfOpenWater) {
  Fog scene = wall_under_open_water(1.0);
  gaussians::Gaussians faint = scene.world;
  faint.logit_opacities = faint.logit_opacities - 2.5;
  TrainerOptions options;
  options.gain_compensation = false;
  MapOptimizer optimizer(faint, options, scene.keyframes.size(), blue_water());
  const auto alpha = [&](const gaussians::Gaussians& gaussians) {
    const Keyframe& keyframe = scene.keyframes[2];
    const MapRendering seen = render_map({.gaussians = gaussians, .medium = blue_water()},
                                         {.intrinsics = keyframe.intrinsics,
                                          .T_camera_world = keyframe.T_camera_world,
                                          .pose_delta = {}});
    const Tensor image = keyframe.image.cpu().to(torch::kFloat32) / 255.0;
    const Tensor kinds = classify_water(image, blue_water().b_inf.expand(image.sizes()));
    return seen.alpha.cpu().masked_select(kinds == -1).mean().item<double>();
  };
  const StepSettings settings = {.sh_degree = 0, .rates = rates_at({}, 1.0, 0.0)};
  const double before = alpha(faint);
  for (std::size_t k = 0; k < 240; ++k) optimizer.step(scene.keyframes, k % 6, settings);
  EXPECT_LT(before, 0.8);
  EXPECT_GT(alpha(optimizer.map()), 1.0 - 0.5 * (1.0 - before));
}

void expect_to_let_go_of_fog(double exposure) {
  const Fog scene = wall_under_open_water(exposure);
  MapOptimizer optimizer(scene.with_fog, {}, scene.keyframes.size(), blue_water());
  for (std::size_t i = 0; i < 6; ++i) optimizer.match_gain(scene.keyframes, i);
  const StepSettings settings = {.sh_degree = 0, .rates = rates_at({}, 1.0, 0.0)};
  for (std::size_t k = 0; k < 480; ++k) optimizer.step(scene.keyframes, k % 6, settings);
  const Tensor before = scene.with_fog.logit_opacities.sigmoid();
  const Tensor after = optimizer.map().logit_opacities.sigmoid();
  const auto mean = [&](const Tensor& t, std::int64_t from, std::int64_t to) {
    return t.slice(0, from, to).mean().item<double>();
  };
  const std::int64_t all = before.size(0);
  EXPECT_LT(mean(after, scene.walls, all), 0.5 * mean(before, scene.walls, all));
  EXPECT_GT(mean(after, 0, scene.walls), 0.9 * mean(before, 0, scene.walls));
  const auto blue = [](const medium::Medium& water) { return water.b_inf[2].item<double>(); };
  EXPECT_NEAR(blue(*optimizer.full_map().medium), blue(blue_water()), 0.03);
}

TEST(MapOptimizer, RemovesFloatersWithColorOfOpenWater) {
  expect_to_let_go_of_fog(1.0);
}

TEST(MapOptimizer, RemovesFloatersAndKeepsVeilingLightInSaturatedImages) {
  expect_to_let_go_of_fog(1.7);
}

}  // namespace
}  // namespace apvi::mapping
