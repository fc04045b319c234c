// SPDX-License-Identifier: BSD-3-Clause
#include "medium/lamp.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "gaussians/devices.hpp"
#include "gaussians/render/render.hpp"
#include "gaussians/render/render_scene.hpp"
#include "gaussians/render/sh_math.hpp"
#include "medium/medium.hpp"
#include "medium/medium_view.hpp"
#include "support/torch_reference.hpp"

namespace apvi::medium {
namespace {

using apvi::test::tensors_near;
using torch::Tensor;

const auto kF64 = torch::dtype(torch::kFloat64);

Lamp lamp_at_the_right() {
  return {.position_m = {0.25, -0.15, 0.05},
          .axis = {0.0, 0.6, 0.8},
          .half_beam_rad = 0.9,
          .share = 0.6};
}

Lamp lamp_at_the_left() {
  return {.position_m = {-0.4, 0.1, 0.0},
          .axis = {0.28, 0.0, 0.96},
          .half_beam_rad = 0.7,
          .edge = 0.4,
          .share = 0.4};
}

Tensor betas() {
  return torch::tensor({0.5, 0.3, 0.7}, kF64);
}

Medium lit_water() {
  return {.beta_d = betas(),
          .beta_b = torch::tensor({0.4, 0.25, 0.5}, kF64),
          .b_inf = torch::tensor({0.03, 0.08, 0.05}, kF64),
          .lamp = LampLight{.lamps = {lamp_at_the_right(), lamp_at_the_left()},
                            .unit_range_m = 1.5,
                            .daylight = torch::tensor({0.1, 0.2, 0.15}, kF64),
                            .backscatter = torch::tensor({0.02, 0.03, 0.01}, kF64)}};
}

TEST(LampIrradiance, FollowsInverseSquareLawAndAttenuationOnAxis) {
  const Lamp lamp = {.position_m = {0.0, 0.0, -1.0}};
  const Tensor points = torch::tensor({{0.0, 0.0, 1.0}, {0.0, 0.0, 3.0}}, torch::kFloat64);
  const Tensor irradiance = LampSum::irradiance({lamp}, 2.0, points).at(betas(), {lamp}).value;
  EXPECT_TRUE(tensors_near(irradiance[0], torch::ones({3}, kF64), 1e-12));
  EXPECT_TRUE(tensors_near(irradiance[1], 0.25 * torch::exp(-2.0 * betas()), 1e-12));
}

TEST(LampIrradiance, IsHalvedAtHalfBeamAngleAndZeroBehind) {
  const Lamp lamp = {.half_beam_rad = 0.7};
  const Tensor points = torch::tensor(
      {{2.0 * std::sin(0.7), 0.0, 2.0 * std::cos(0.7)}, {0.0, 0.1, -2.0}}, torch::kFloat64);
  const Tensor irradiance = LampSum::irradiance({lamp}, 2.0, points).at(betas(), {lamp}).value;
  EXPECT_TRUE(tensors_near(irradiance[0], torch::full({3}, 0.5, kF64), 1e-12));
  EXPECT_EQ(irradiance[1].abs().max().item<double>(), 0.0);
}

/// Reference integral for one channel with many steps.
double backscatter_by_sums(const Lamp& lamp, double unit_m, double beta,
                           const std::array<double, 3>& ray, double range) {
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
    const double u = (1.0 - along / d) / (1.0 - std::cos(lamp.half_beam_rad));
    const double beam = std::exp(-std::log(2.0) * ((1.0 - lamp.edge) * u + lamp.edge * u * u));
    sum += beam * unit_m * unit_m / square * std::exp(-beta * (d - unit_m + t)) * range / kSteps;
  }
  return sum;
}

TEST(LampSum, BackscatterMatchesNumericalIntegration) {
  const std::vector<Lamp> lamps = {lamp_at_the_right(), lamp_at_the_left()};
  const std::array<double, 3> ray = {0.36, -0.48, 0.8};
  const Tensor rays = torch::tensor({ray[0], ray[1], ray[2]}, torch::kFloat64).expand({4, 3});
  const Tensor ranges = torch::tensor({0.3, 1.0, 2.5, 5.9}, torch::kFloat64);
  const Tensor lamp_backscatter =
      LampSum::backscatter(lamps, 1.5, rays, ranges).at(betas(), lamps).value;
  for (std::int64_t i = 0; i < 4; ++i) {
    for (std::int64_t c = 0; c < 3; ++c) {
      double expected = 0.0;
      for (const Lamp& lamp : lamps) {
        expected += lamp.share * backscatter_by_sums(lamp, 1.5, betas()[c].item<double>(), ray,
                                                     ranges[i].item<double>());
      }
      EXPECT_NEAR(lamp_backscatter[i][c].item<double>() / expected, 1.0, 0.02) << i << ", " << c;
    }
  }
}

/// Central difference of `value(step)` at 0.
template <typename Function>
Tensor slope_of(const Function& value) {
  constexpr double kStep = 1e-6;
  return (value(kStep) - value(-kStep)) / (2.0 * kStep);
}

void expect_derivatives_of(const LampSum& sum, const std::vector<Lamp>& lamps) {
  const LampTerm found = sum.at(betas(), lamps, /*with_derivatives=*/true);
  const auto with = [&](const auto& change) {
    std::vector<Lamp> changed = lamps;
    for (Lamp& lamp : changed) change(lamp);
    return sum.at(betas(), changed).value;
  };
  EXPECT_TRUE(tensors_near(
      found.by_beta_d, slope_of([&](double h) { return sum.at(betas() + h, lamps).value; }), 1e-7));
  EXPECT_TRUE(tensors_near(found.by_half_beam, slope_of([&](double h) {
                             return with([h](Lamp& l) { l.half_beam_rad *= std::exp(h); });
                           }),
                           1e-7));
  EXPECT_TRUE(tensors_near(found.by_edge,
                           slope_of([&](double h) { return with([h](Lamp& l) { l.edge += h; }); }),
                           1e-7));
}

TEST(LampSum, DerivativesMatchFiniteDifferences) {
  torch::manual_seed(5);
  const std::vector<Lamp> lamps = {lamp_at_the_right(), lamp_at_the_left()};
  const Tensor points = torch::rand({20, 3}, kF64) * 2.0 + torch::tensor({-1.0, -1.0, 0.5}, kF64);
  const Tensor ranges = points.norm(2, 1);
  expect_derivatives_of(LampSum::irradiance(lamps, 1.5, points), lamps);
  expect_derivatives_of(LampSum::backscatter(lamps, 1.5, points / ranges.unsqueeze(1), ranges),
                        lamps);
}

TEST(BeamProfile, IsHalvedAtTheHalfBeamAngleWithAnyEdge) {
  for (const double edge : {0.0, 0.4, 1.0}) {
    const Lamp lamp = {.half_beam_rad = 0.7, .edge = edge};
    const double x = 1.0 - std::cos(0.7);
    const BeamProfile beam = beam_profile(lamp);
    EXPECT_NEAR(std::exp(-x * (beam.linear + beam.square * x)), 0.5, 1e-12) << edge;
  }
}

/// Points [H,W,3] in the camera frame of a depth [H,W].
Tensor camera_points(const Tensor& depth, const gaussians::Intrinsics& k) {
  const Tensor x = (torch::arange(k.width, kF64) + 0.5 - k.cx) / k.fx;
  const Tensor y = (torch::arange(k.height, kF64) + 0.5 - k.cy) / k.fy;
  return torch::stack({x * depth, y.unsqueeze(1) * depth, depth}, 2);
}

TEST(MediumView, ImageMatchesPointwiseTransferWithLamp) {
  torch::manual_seed(6);
  const gaussians::Intrinsics camera = {
      .fx = 50.0, .fy = 50.0, .cx = 32.0, .cy = 24.0, .width = 64, .height = 48};
  const Tensor slope = torch::linspace(1.0, 2.5, 48, kF64).unsqueeze(1).expand({48, 64});
  const Tensor color = torch::rand({48, 64, 3}, kF64);
  const Medium water = lit_water();
  const Tensor points = camera_points(slope, camera).view({-1, 3});
  const MediumView view(water, camera);
  const Tensor lit = color * view.illumination_at(points, torch::eye(4, kF64)).view_as(color);
  const Tensor image = view.apply(lit, slope, torch::ones_like(slope));
  const MediumTransfer seen = medium_transfer(points, water);
  const Tensor expected = seen.gain * color.view({-1, 3}) + seen.veiling_light;
  EXPECT_TRUE(tensors_near(image.view({-1, 3}), expected, 1e-3));
  EXPECT_GT((image - color).abs().max().item<double>(), 0.2);
}

TEST(MediumView, EqualsEquationEightWithoutLamp) {
  torch::manual_seed(7);
  const gaussians::Intrinsics camera = {
      .fx = 50.0, .fy = 50.0, .cx = 4.0, .cy = 3.0, .width = 8, .height = 6};
  Medium water = lit_water();
  water.lamp.reset();
  const Tensor depth = torch::rand({6, 8}, kF64) + 0.5;
  const Tensor color = torch::rand({6, 8, 3}, kF64);
  const Tensor alpha = torch::rand({6, 8}, kF64);
  const MediumView view(water, camera);
  EXPECT_TRUE(tensors_near(
      view.apply(color, depth, alpha),
      apply_medium(color, gaussians::depth_to_range(depth, camera), alpha, water), 1e-15));
  EXPECT_FALSE(view.illumination_at(color.view({-1, 3}), torch::eye(4, kF64)).defined());
}

TEST(MediumView, IlluminationUsesCameraFrameOnEveryDevice) {
  torch::manual_seed(8);
  const gaussians::Intrinsics camera = {
      .fx = 50.0, .fy = 50.0, .cx = 4.0, .cy = 3.0, .width = 8, .height = 6};
  const gaussians::View view = gaussians::test::make_view(8, 6);
  const Tensor world = torch::rand({500, 3}, kF64) * 4.0 - 2.0;
  const Tensor T = view.T_camera_world;
  const Tensor points =
      world.mm(T.slice(0, 0, 3).slice(1, 0, 3).t()) + T.slice(0, 0, 3).select(1, 3);
  const Tensor expected = lamp_light(*lit_water().lamp, betas(), points);
  ASSERT_GT((expected - lit_water().lamp->daylight).max().item<double>(), 0.1);
  for (const torch::Device& device : apvi::test::available_devices()) {
    const auto options = torch::dtype(torch::kFloat32).device(device);
    Medium water = lit_water();
    for (Tensor* t : {&water.beta_d, &water.beta_b, &water.b_inf}) *t = t->to(options);
    const Tensor light = MediumView(water, camera).illumination_at(world.to(options), T);
    EXPECT_TRUE(
        tensors_near(light.cpu().to(torch::kFloat64) / expected, torch::ones_like(expected), 1e-4))
        << device;
  }
}

/// An image with illumination, and the gradients of its sum with respect to the parameters.
struct Lit {
  Tensor color;
  std::vector<Tensor> gradients;
};
Lit draw(const gaussians::Gaussians& from, const Tensor& light) {
  const gaussians::Gaussians map = gaussians::test::map_tensors(
      from, [](const Tensor& t) { return t.detach().requires_grad_(true); });
  const auto members = map.tensors();
  std::vector<Tensor> leaves;
  for (const Tensor* tensor : members) leaves.push_back(*tensor);
  const gaussians::RenderOutput out = gaussians::render(map, gaussians::test::make_view(61, 47),
                                                        {.background = {}, .light = light});
  return {out.color.detach(), torch::autograd::grad({out.color.sum()}, leaves)};
}

// A color 0.5 + dc Y + rest Y' times L has the coefficients dc L + 0.5 (L - 1) / Y and rest L.
TEST(RenderWithLight, EqualsScalingTheColors) {
  for (const torch::Device& device : apvi::test::available_devices()) {
    const auto type = device.is_cuda() ? torch::kFloat32 : torch::kFloat64;
    const gaussians::Gaussians map = gaussians::test::map_tensors(
        gaussians::test::make_gaussians(60), [&](const Tensor& t) { return t.to(device, type); });
    const Tensor light = torch::rand({60, 3}, kF64).to(device, type) * 2.0 + 0.1;
    gaussians::Gaussians lit = map;
    lit.sh_dc = map.sh_dc * light + 0.5 * (light - 1.0) / gaussians::kSh0;
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

TEST(RenderWithLight, RejectsLightOfWrongSize) {
  const gaussians::Gaussians map = gaussians::test::make_gaussians(6);
  EXPECT_THROW(draw(map, torch::ones({5, 3}, kF64)), c10::Error);
  EXPECT_THROW(draw(map, torch::ones({6, 3}, torch::kFloat32)), c10::Error);
}

TEST(LampLight, TensorRoundTrip) {
  const LampLight light = *lit_water().lamp;
  const LampLight back = lamp_from_tensor(lamp_to_tensor(light));
  ASSERT_EQ(back.lamps.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(back.lamps[i].position_m, light.lamps[i].position_m);
    EXPECT_EQ(back.lamps[i].axis, light.lamps[i].axis);
    EXPECT_EQ(back.lamps[i].half_beam_rad, light.lamps[i].half_beam_rad);
    EXPECT_EQ(back.lamps[i].edge, light.lamps[i].edge);
    EXPECT_EQ(back.lamps[i].share, light.lamps[i].share);
  }
  EXPECT_EQ(back.unit_range_m, light.unit_range_m);
  EXPECT_TRUE(torch::equal(back.daylight, light.daylight));
  EXPECT_TRUE(torch::equal(back.backscatter, light.backscatter));
  EXPECT_THROW(lamp_from_tensor(torch::zeros({13}, kF64)), c10::Error);
  EXPECT_THROW(lamp_from_tensor(torch::zeros({7}, kF64)), c10::Error);
  EXPECT_THROW(lamp_from_tensor(torch::zeros({7 + 9 * 5}, kF64)), c10::Error);
}

TEST(LampLight, ReadsTheNumbersOfASingleLamp) {
  const LampLight light = lamp_from_tensor(torch::arange(14, kF64));
  ASSERT_EQ(light.lamps.size(), 1U);
  EXPECT_EQ(light.lamps[0].position_m, (std::array<double, 3>{0.0, 1.0, 2.0}));
  EXPECT_EQ(light.lamps[0].axis, (std::array<double, 3>{3.0, 4.0, 5.0}));
  EXPECT_EQ(light.lamps[0].half_beam_rad, 6.0);
  EXPECT_EQ(light.lamps[0].share, 1.0);
  EXPECT_EQ(light.unit_range_m, 7.0);
  EXPECT_EQ(light.daylight[2].item<double>(), 10.0);
  EXPECT_EQ(light.backscatter[0].item<double>(), 11.0);
}

TEST(LampLight, ReadsLampsWithoutAnEdge) {
  const LampLight light = lamp_from_tensor(torch::arange(7 + 8 * 2, kF64));
  ASSERT_EQ(light.lamps.size(), 2U);
  EXPECT_EQ(light.lamps[1].position_m, (std::array<double, 3>{15.0, 16.0, 17.0}));
  EXPECT_EQ(light.lamps[1].half_beam_rad, 21.0);
  EXPECT_EQ(light.lamps[1].edge, 0.0);
  EXPECT_EQ(light.lamps[1].share, 22.0);
}

TEST(LampIrradiance, AddsTheLampsByTheirShares) {
  torch::manual_seed(9);
  const Tensor points = torch::rand({20, 3}, kF64) * 2.0 + torch::tensor({-1.0, -1.0, 0.5}, kF64);
  Lamp right = lamp_at_the_right();
  Lamp left = lamp_at_the_left();
  const Tensor both =
      LampSum::irradiance({right, left}, 1.5, points).at(betas(), {right, left}).value;
  right.share = left.share = 1.0;
  const Tensor sum = 0.6 * LampSum::irradiance({right}, 1.5, points).at(betas(), {right}).value +
                     0.4 * LampSum::irradiance({left}, 1.5, points).at(betas(), {left}).value;
  EXPECT_TRUE(tensors_near(both, sum, 1e-12));
}

TEST(LampIrradiance, IncludesEachLampsAngleOfIncidence) {
  // Lamps at 45 degrees to either side of a surface that faces the first: the second grazes it.
  const std::vector<Lamp> lamps = {{.position_m = {-1.0, 0.0, 1.0}, .axis = {1.0, 0.0, 0.0}},
                                   {.position_m = {0.0, 0.0, 0.0}, .axis = {0.0, 0.0, 1.0}}};
  const Tensor point = torch::tensor({{0.0, 0.0, 1.0}}, kF64);
  const Tensor normal = torch::tensor({{-1.0, 0.0, 0.0}}, kF64);
  const Tensor light = LampSum::irradiance(lamps, 1.0, point, normal).at(betas(), lamps).value;
  EXPECT_TRUE(tensors_near(light, torch::full({1, 3}, 1.0 + 0.2, kF64), 1e-12));
}

}  // namespace
}  // namespace apvi::medium
