// SPDX-License-Identifier: BSD-3-Clause
// Joint optimization of map and medium separates colors from the medium.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <vector>

#include "gaussians/metrics/losses.hpp"
#include "gaussians/metrics/metrics.hpp"
#include "gaussians/model/gaussian_store.hpp"
#include "gaussians/render/render.hpp"
#include "gaussians/render/sh_math.hpp"
#include "medium/medium.hpp"
#include "medium/medium_initialization.hpp"
#include "medium/medium_optimizer.hpp"

namespace apvi::medium {
namespace {

using torch::Tensor;

Medium true_water() {
  return {.beta_d = torch::tensor({0.36, 0.16, 0.12}),
          .beta_b = torch::tensor({0.30, 0.14, 0.11}),
          .b_inf = torch::tensor({0.10, 0.30, 0.35})};
}

/// A textured sea bed of discs, 8 m wide and 12 m long, one meter below the cameras. Camera axes: y
/// points down.
gaussians::Gaussians sea_bed() {
  const Tensor x = torch::linspace(-4.0, 4.0, 41).reshape({41, 1}).expand({41, 61}).flatten();
  const Tensor z = torch::linspace(0.0, 12.0, 61).reshape({1, 61}).expand({41, 61}).flatten();
  const Tensor y = 1.0 + 0.15 * torch::sin(1.3 * x) * torch::cos(1.1 * z);
  const std::int64_t n = x.size(0);
  const Tensor phase = torch::tensor({0.0, 2.0, 4.0});
  const Tensor pattern =
      torch::sin(2.1 * x.unsqueeze(1) + phase) * torch::cos(1.7 * z.unsqueeze(1) - 0.5 * phase);
  const Tensor color = 0.45 + 0.3 * pattern;
  return {.means = torch::stack({x, y, z}, 1),
          .log_scales = torch::tensor({0.12, 0.02, 0.12}).log().repeat({n, 1}),
          .quaternions = torch::tensor({1.0F, 0.0F, 0.0F, 0.0F}).repeat({n, 1}),
          .logit_opacities = torch::full({n}, 3.0F),
          .sh_dc = (color - 0.5) / gaussians::kSh0,
          .sh_rest = torch::zeros({n, 0, 3})};
}

/// Twenty cameras along the bed at several heights, looking ahead and slightly down.
std::vector<gaussians::View> dive() {
  std::vector<gaussians::View> views;
  for (int i = 0; i < 20; ++i) {
    const double pitch = 0.15 + 0.1 * (i % 3);
    const double z = -1.5 + 0.55 * i;
    const double x = 1.2 * std::sin(1.7 * i);
    const double y = 0.4 * std::cos(2.3 * i);
    const Tensor R = torch::tensor({1.0, 0.0, 0.0,                           //
                                    0.0, std::cos(pitch), -std::sin(pitch),  //
                                    0.0, std::sin(pitch), std::cos(pitch)},
                                   torch::kFloat64)
                         .reshape({3, 3});
    Tensor T = torch::eye(4, torch::kFloat64);
    T.slice(0, 0, 3).slice(1, 0, 3).copy_(R);
    T.slice(0, 0, 3).select(1, 3).copy_(
        -torch::matmul(R, torch::tensor({x, y, z}, torch::kFloat64)));
    views.push_back(
        {.intrinsics = {.fx = 50.0, .fy = 50.0, .cx = 32.0, .cy = 24.0, .width = 64, .height = 48},
         .T_camera_world = T,
         .pose_delta = {}});
  }
  return views;
}

struct Seen {
  Tensor clear, range, water;
};

Seen see(const gaussians::Gaussians& gaussians, const gaussians::View& view, const Medium& medium) {
  const gaussians::RenderOutput out =
      gaussians::render(gaussians, view, gaussians::RenderOptions());
  const Tensor range = gaussians::depth_to_range(out.depth, view.intrinsics);
  return {out.color, range, apply_medium(out.color, range, out.alpha, medium)};
}

double worst_relative_error(const Tensor& got, const Tensor& truth) {
  return ((got - truth).abs() / truth).max().item<double>();
}

TEST(MediumRecovery, SeparatesMediumAndColorsFromTwentyViews) {
  const Medium truth = true_water();
  const gaussians::Gaussians bed = sea_bed();
  const std::vector<gaussians::View> views = dive();
  std::vector<Seen> images;
  std::vector<Tensor> colors;
  std::vector<Tensor> ranges;
  for (const gaussians::View& view : views) {
    const torch::NoGradGuard no_grad;
    images.push_back(see(bed, view, truth));
    colors.push_back(images.back().water);
    ranges.push_back(images.back().range);
  }

  gaussians::Gaussians gray = bed;
  gray.sh_dc = torch::zeros_like(bed.sh_dc);
  gaussians::GaussianStore store(gray);
  Medium start = initialize_medium(colors, ranges);
  for (Tensor* t : {&start.beta_d, &start.beta_b, &start.b_inf}) *t = t->to(torch::kFloat32);
  MediumOptimizer water(start, 1e-2);
  gaussians::GaussianLearningRates rates = {.means = 0.0,
                                            .log_scales = 0.0,
                                            .quaternions = 0.0,
                                            .logit_opacities = 0.0,
                                            .sh_dc = 2e-2,
                                            .sh_rest = 0.0};
  constexpr int kSteps = 1600;
  for (int step = 0; step < kSteps; ++step) {
    const std::size_t i = static_cast<std::size_t>(step * 7) % views.size();
    const Tensor image = see(store.view(), views[i], water.medium()).water;
    gaussians::photometric_loss(image, colors[i], 0.2).backward();
    store.step(rates);
    water.step();
    if (step == kSteps / 2) rates.sh_dc *= 0.2;
  }

  const torch::NoGradGuard no_grad;
  EXPECT_LT(worst_relative_error(water.medium().beta_d, truth.beta_d), 0.05);
  EXPECT_LT(worst_relative_error(water.medium().beta_b, truth.beta_b), 0.05);
  EXPECT_LT(worst_relative_error(water.medium().b_inf, truth.b_inf), 0.05);
  double worst_db = 1e9;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Tensor restored = see(store.view(), views[i], truth).clear;  // without the medium
    worst_db = std::min(worst_db, gaussians::psnr(restored, images[i].clear));
  }
  EXPECT_GE(worst_db, 30.0);
  RecordProperty("worst_restored_psnr_db", std::to_string(worst_db));
}

}  // namespace
}  // namespace apvi::medium
