// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/splat/lamp.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "apvi/splat/medium.hpp"
#include "apvi/splat/medium_view.hpp"
#include "apvi/splat/render.hpp"
#include "apvi/splat/sh_math.hpp"
#include "devices.hpp"
#include "render_scene.hpp"
#include "support/torch_reference.hpp"

namespace apvi::splat {
namespace {

using apvi::test::tensors_near;
using torch::Tensor;

const auto kF64 = torch::dtype(torch::kFloat64);

Lamp lamp_at_the_right() {
  return {.position_m = {0.25, -0.15, 0.05}, .axis = {0.0, 0.6, 0.8}, .half_beam_rad = 0.9};
}

Tensor betas() {
  return torch::tensor({0.5, 0.3, 0.7}, kF64);
}

Medium lit_water() {
  return {.beta_d = betas(),
          .beta_b = torch::tensor({0.4, 0.25, 0.5}, kF64),
          .b_inf = torch::tensor({0.03, 0.08, 0.05}, kF64),
          .lamp = LampLight{.lamp = lamp_at_the_right(),
                            .unit_range_m = 1.5,
                            .daylight = torch::tensor({0.1, 0.2, 0.15}, kF64),
                            .glow = torch::tensor({0.02, 0.03, 0.01}, kF64)}};
}

TEST(LampShine, FallsWithTheSquareOfTheDistanceAndTheWaterOnItsAxis) {
  const Lamp lamp = {.position_m = {0.0, 0.0, -1.0}};
  const Tensor points = torch::tensor({{0.0, 0.0, 1.0}, {0.0, 0.0, 3.0}}, torch::kFloat64);
  const Tensor shine = lamp_shine(lamp, 2.0, betas(), points).value;
  EXPECT_TRUE(tensors_near(shine[0], torch::ones({3}, kF64), 1e-12));
  EXPECT_TRUE(tensors_near(shine[1], 0.25 * torch::exp(-2.0 * betas()), 1e-12));
}

TEST(LampShine, IsHalfAsBrightAtHalfItsBeamAndDarkBehind) {
  const Lamp lamp = {.half_beam_rad = 0.7};
  const Tensor points = torch::tensor(
      {{2.0 * std::sin(0.7), 0.0, 2.0 * std::cos(0.7)}, {0.0, 0.1, -2.0}}, torch::kFloat64);
  const Tensor shine = lamp_shine(lamp, 2.0, betas(), points).value;
  EXPECT_TRUE(tensors_near(shine[0], torch::full({3}, 0.5, kF64), 1e-12));
  EXPECT_EQ(shine[1].abs().max().item<double>(), 0.0);
}

/// The integral of the header for one colour, in very many steps.
double haze_by_sums(const Lamp& lamp, double unit_m, double beta, const std::array<double, 3>& ray,
                    double range) {
  constexpr int kSteps = 200000;
  double sum = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    const double t = range * (i + 0.5) / kSteps;
    double square = 0.0;
    double along = 0.0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double from = t * ray[k] - lamp.position_m[k];
      square += from * from;
      along += from * lamp.axis[k];
    }
    const double d = std::sqrt(square);
    if (along <= 0.0) continue;
    const double beam =
        std::exp(-std::log(2.0) * (1.0 - along / d) / (1.0 - std::cos(lamp.half_beam_rad)));
    sum += beam * unit_m * unit_m / square * std::exp(-beta * (d - unit_m + t)) * range / kSteps;
  }
  return sum;
}

TEST(LampHaze, IsTheIntegralOfWhatTheWaterSendsBack) {
  const Lamp lamp = lamp_at_the_right();
  const std::array<double, 3> ray = {0.36, -0.48, 0.8};
  const Tensor rays = torch::tensor({ray[0], ray[1], ray[2]}, torch::kFloat64).expand({4, 3});
  const Tensor ranges = torch::tensor({0.3, 1.0, 2.5, 5.9}, torch::kFloat64);
  const Tensor haze = lamp_haze(lamp, 1.5, betas(), rays, ranges).value;
  for (std::int64_t i = 0; i < 4; ++i) {
    for (std::int64_t c = 0; c < 3; ++c) {
      const double expected =
          haze_by_sums(lamp, 1.5, betas()[c].item<double>(), ray, ranges[i].item<double>());
      EXPECT_NEAR(haze[i][c].item<double>() / expected, 1.0, 0.02) << i << ", " << c;
    }
  }
}

TEST(LampTerms, DerivativesByBetaAreThoseOfDifferences) {
  torch::manual_seed(5);
  const Lamp lamp = lamp_at_the_right();
  const Tensor points = torch::rand({20, 3}, kF64) * 2.0 + torch::tensor({-1.0, -1.0, 0.5}, kF64);
  const Tensor ranges = points.norm(2, 1);
  const Tensor rays = points / ranges.unsqueeze(1);
  constexpr double kStep = 1e-6;
  const Tensor more = betas() + kStep;
  const Tensor less = betas() - kStep;
  const auto shine = [&](const Tensor& b) { return lamp_shine(lamp, 1.5, b, points); };
  const auto haze = [&](const Tensor& b) { return lamp_haze(lamp, 1.5, b, rays, ranges); };
  EXPECT_TRUE(tensors_near(shine(betas()).by_beta_d,
                           (shine(more).value - shine(less).value) / (2.0 * kStep), 1e-7));
  EXPECT_TRUE(tensors_near(haze(betas()).by_beta_d,
                           (haze(more).value - haze(less).value) / (2.0 * kStep), 1e-7));
}

/// Points [H,W,3] in the camera's frame that a depth [H,W] shows.
Tensor camera_points(const Tensor& depth, const Intrinsics& k) {
  const Tensor x = (torch::arange(k.width, kF64) + 0.5 - k.cx) / k.fx;
  const Tensor y = (torch::arange(k.height, kF64) + 0.5 - k.cy) / k.fy;
  return torch::stack({x * depth, y.unsqueeze(1) * depth, depth}, 2);
}

TEST(MediumView, APictureAndItsPointsAgreeUnderALamp) {
  torch::manual_seed(6);
  const Intrinsics camera = {
      .fx = 50.0, .fy = 50.0, .cx = 32.0, .cy = 24.0, .width = 64, .height = 48};
  const Tensor slope = torch::linspace(1.0, 2.5, 48, kF64).unsqueeze(1).expand({48, 64});
  const Tensor color = torch::rand({48, 64, 3}, kF64);
  const Medium water = lit_water();
  const Tensor points = camera_points(slope, camera).view({-1, 3});
  const MediumView through(water, camera);
  const Tensor lit = color * through.light_on(points, torch::eye(4, kF64)).view_as(color);
  const Tensor picture = through.see(lit, slope, torch::ones_like(slope));
  const SeenAs seen = seen_as(points, water);
  const Tensor expected = seen.gain * color.view({-1, 3}) + seen.veil;
  EXPECT_TRUE(tensors_near(picture.view({-1, 3}), expected, 1e-3));
  EXPECT_GT((picture - color).abs().max().item<double>(), 0.2);
}

TEST(MediumView, WithoutALampIsEquationEightAlone) {
  torch::manual_seed(7);
  const Intrinsics camera = {.fx = 50.0, .fy = 50.0, .cx = 4.0, .cy = 3.0, .width = 8, .height = 6};
  Medium water = lit_water();
  water.lamp.reset();
  const Tensor depth = torch::rand({6, 8}, kF64) + 0.5;
  const Tensor color = torch::rand({6, 8, 3}, kF64);
  const Tensor alpha = torch::rand({6, 8}, kF64);
  const MediumView through(water, camera);
  EXPECT_TRUE(tensors_near(through.see(color, depth, alpha),
                           apply_medium(color, depth_to_range(depth, camera), alpha, water),
                           1e-15));
  EXPECT_FALSE(through.light_on(color.view({-1, 3}), torch::eye(4, kF64)).defined());
}

TEST(MediumView, LightIsThatOfTheCamerasFrameOnEveryDevice) {
  torch::manual_seed(8);
  const Intrinsics camera = {.fx = 50.0, .fy = 50.0, .cx = 4.0, .cy = 3.0, .width = 8, .height = 6};
  const View view = test::make_view(8, 6);
  const Tensor world = torch::rand({500, 3}, kF64) * 4.0 - 2.0;
  const Tensor T = view.T_camera_world;
  const Tensor points =
      world.mm(T.slice(0, 0, 3).slice(1, 0, 3).t()) + T.slice(0, 0, 3).select(1, 3);
  const Tensor expected = lamp_light(*lit_water().lamp, betas(), points);
  ASSERT_GT((expected - lit_water().lamp->daylight).max().item<double>(), 0.1);
  for (const torch::Device& device : apvi::test::devices_here()) {
    const auto options = torch::dtype(torch::kFloat32).device(device);
    Medium water = lit_water();
    for (Tensor* t : {&water.beta_d, &water.beta_b, &water.b_inf}) *t = t->to(options);
    const Tensor light = MediumView(water, camera).light_on(world.to(options), T);
    EXPECT_TRUE(
        tensors_near(light.cpu().to(torch::kFloat64) / expected, torch::ones_like(expected), 1e-4))
        << device;
  }
}

/// A picture in a light, and the derivatives of its sum by the parameters.
struct Lit {
  Tensor color;
  std::vector<Tensor> gradients;
};
Lit draw(const Gaussians& from, const Tensor& light) {
  const Gaussians map =
      test::map_tensors(from, [](const Tensor& t) { return t.detach().requires_grad_(true); });
  const auto members = map.tensors();
  std::vector<Tensor> leaves;
  for (const Tensor* tensor : members) leaves.push_back(*tensor);
  const RenderOutput out = render(map, test::make_view(61, 47), {.background = {}, .light = light});
  return {out.color.detach(), torch::autograd::grad({out.color.sum()}, leaves)};
}

// A colour 0.5 + dc Y + rest Y' times L is that of dc L + 0.5 (L - 1) / Y and rest L.
TEST(RenderInALight, IsAsIfTheColoursThemselvesWereSo) {
  for (const torch::Device& device : apvi::test::devices_here()) {
    const auto type = device.is_cuda() ? torch::kFloat32 : torch::kFloat64;
    const Gaussians map = test::map_tensors(test::make_gaussians(60),
                                            [&](const Tensor& t) { return t.to(device, type); });
    const Tensor light = torch::rand({60, 3}, kF64).to(device, type) * 2.0 + 0.1;
    Gaussians lit = map;
    lit.sh_dc = map.sh_dc * light + 0.5 * (light - 1.0) / kSh0;
    lit.sh_rest = map.sh_rest * light.unsqueeze(1);
    const Lit got = draw(map, light);
    const Lit expected = draw(lit, {});
    const double tolerance = device.is_cuda() ? 2e-3 : 1e-9;
    EXPECT_TRUE(tensors_near(got.color, expected.color, device.is_cuda() ? 1e-4 : 1e-12));
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_TRUE(tensors_near(got.gradients[i], expected.gradients[i], tolerance)) << i;
    }
    EXPECT_TRUE(tensors_near(got.gradients[4], expected.gradients[4] * light, tolerance));
    EXPECT_TRUE(
        tensors_near(got.gradients[5], expected.gradients[5] * light.unsqueeze(1), tolerance));
  }
}

TEST(RenderInALight, RefusesALightForOtherGaussians) {
  const Gaussians map = test::make_gaussians(6);
  EXPECT_THROW(draw(map, torch::ones({5, 3}, kF64)), c10::Error);
  EXPECT_THROW(draw(map, torch::ones({6, 3}, torch::kFloat32)), c10::Error);
}

TEST(LampLight, SurvivesAsNumbers) {
  const LampLight light = *lit_water().lamp;
  const LampLight back = lamp_from_numbers(to_numbers(light));
  EXPECT_EQ(back.lamp.position_m, light.lamp.position_m);
  EXPECT_EQ(back.lamp.axis, light.lamp.axis);
  EXPECT_EQ(back.lamp.half_beam_rad, light.lamp.half_beam_rad);
  EXPECT_EQ(back.unit_range_m, light.unit_range_m);
  EXPECT_TRUE(torch::equal(back.daylight, light.daylight));
  EXPECT_TRUE(torch::equal(back.glow, light.glow));
  EXPECT_THROW(lamp_from_numbers(torch::zeros({13}, kF64)), c10::Error);
}

}  // namespace
}  // namespace apvi::splat
