// SPDX-License-Identifier: BSD-3-Clause
// Tests the derivatives of rendering against central differences and a reference implementation.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <functional>

#include "gaussians/render/render_scene.hpp"
#include "support/torch_raster.hpp"
#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using apvi::test::reference_render;
using apvi::test::ReferenceImage;
using apvi::test::tensors_near;
using test::make_gaussians;
using test::make_view;
using torch::Tensor;

constexpr std::array<const char*, 8> kNames = {
    "means", "log_scales", "quaternions", "logit_opacities",
    "sh_dc", "sh_rest",    "pose",        "background"};

struct Scene {
  Gaussians gaussians;
  View view;
  RenderOptions options;

  std::vector<Tensor> leaves() const {
    std::vector<Tensor> out;
    for (const Tensor* tensor : gaussians.tensors()) out.push_back(*tensor);
    out.push_back(view.pose_delta);
    out.push_back(options.background);
    return out;
  }
  RenderOutput drawn() const { return render(gaussians, view, options); }
};

Scene make_scene(int seed, bool antialiased = false, std::int64_t count = 40) {
  Scene scene = {.gaussians = make_gaussians(count, torch::kFloat64, 3, seed),
                 .view = make_view(),
                 .options = {}};
  scene.options.antialiased = antialiased;
  const auto f64 = torch::dtype(torch::kFloat64);
  scene.view.pose_delta = torch::randn({6}, f64) * 0.05;
  scene.options.background = torch::rand({3}, f64);
  for (const Tensor& leaf : scene.leaves()) leaf.requires_grad_(true);
  return scene;
}

/// A loss of every pixel of all three images.
template <typename Images>
Tensor loss_of(const Images& images) {
  torch::manual_seed(7);
  const auto weights = [](const Tensor& t) {
    return torch::randn(t.sizes(), torch::kFloat64).to(t.options().requires_grad(false));
  };
  return (weights(images.color) * images.color).sum() +
         (weights(images.depth) * images.depth).sum() * 0.1 +
         (weights(images.alpha) * images.alpha).sum();
}

/// Central difference that is robust to discontinuities: where a step takes a pixel across the rim
/// of a splat (alpha = 1/255) or changes early termination, the image jumps. The median of three
/// step sizes is right unless two of them jump.
double slope(const std::function<Tensor()>& loss, double& x) {
  const double kept = x;
  std::array<double, 3> slopes = {};
  const std::array<double, 3> steps = {3e-6, 1e-6, 3e-7};
  for (std::size_t i = 0; i < steps.size(); ++i) {
    x = kept + steps[i];
    const double above = loss().item<double>();
    x = kept - steps[i];
    slopes[i] = (above - loss().item<double>()) / (2.0 * steps[i]);
  }
  x = kept;
  std::sort(slopes.begin(), slopes.end());
  return slopes[1];
}

/// Largest error of a gradient, relative to itself or to a thousandth of the largest of its kind.
double gradient_error(const std::function<Tensor()>& loss, const Tensor& leaf, const Tensor& got) {
  const torch::NoGradGuard no_grad;
  auto* const x = leaf.data_ptr<double>();
  const Tensor flat = got.contiguous();
  const double floor = 1e-3 * flat.abs().max().item<double>();
  double worst = 0.0;
  for (std::int64_t i = 0; i < leaf.numel(); ++i) {
    const double expected = slope(loss, x[i]);
    const double error = std::abs(flat.data_ptr<double>()[i] - expected);
    worst = std::max(worst, error / std::max(std::abs(expected), floor));
  }
  return worst;
}

class RenderGradients : public testing::TestWithParam<bool> {};

TEST_P(RenderGradients, MatchFiniteDifferencesInEveryParameter) {
  const Scene scene = make_scene(3, GetParam(), 24);
  const auto loss = [&scene] { return loss_of(scene.drawn()); };
  const std::vector<Tensor> leaves = scene.leaves();
  const auto got = torch::autograd::grad({loss()}, leaves);
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    EXPECT_GT(got[i].abs().max().item<double>(), 1e-3) << kNames[i];
    EXPECT_LT(gradient_error(loss, leaves[i], got[i]), 1e-5) << kNames[i];
  }
}

TEST_P(RenderGradients, MatchReferenceImplementation) {
  for (int seed = 1; seed <= 5; ++seed) {
    const Scene scene = make_scene(seed, GetParam(), 60);
    const RenderOutput drawn = scene.drawn();
    const ReferenceImage expected = reference_render(scene.gaussians, scene.view, scene.options);
    EXPECT_TRUE(tensors_near(drawn.color, expected.color, 1e-10)) << seed;
    EXPECT_TRUE(tensors_near(drawn.depth, expected.depth, 1e-10)) << seed;
    EXPECT_TRUE(tensors_near(drawn.alpha, expected.alpha, 1e-10)) << seed;
    const auto got = torch::autograd::grad({loss_of(drawn)}, scene.leaves());
    const auto wanted = torch::autograd::grad({loss_of(expected)}, scene.leaves());
    for (std::size_t i = 0; i < got.size(); ++i) {
      EXPECT_TRUE(tensors_near(got[i], wanted[i], 1e-8)) << kNames[i] << ", seed " << seed;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Modes, RenderGradients, testing::Bool(),
                         [](const auto& mode) { return mode.param ? "antialiased" : "classic"; });

TEST(RenderedNeedles, MatchReferenceFarOutsideTheImage) {
  Scene scene = make_scene(11, false, 40);
  {
    const torch::NoGradGuard no_grad;
    scene.gaussians.log_scales.select(1, 0).fill_(0.7);  // 2 m long
    scene.gaussians.log_scales.select(1, 1).fill_(-5.0);
    scene.gaussians.means.mul_(torch::tensor({2.0, 2.0, 1.0}, torch::kFloat64));
  }
  const RenderOutput drawn = scene.drawn();
  const ReferenceImage expected = reference_render(scene.gaussians, scene.view, scene.options);
  EXPECT_TRUE(tensors_near(drawn.color, expected.color, 1e-9));
  const auto got = torch::autograd::grad({loss_of(drawn)}, scene.leaves());
  const auto wanted = torch::autograd::grad({loss_of(expected)}, scene.leaves());
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_TRUE(tensors_near(got[i], wanted[i], 1e-7)) << kNames[i];
  }
}

TEST(RenderEarlyTermination, MatchesReference) {
  Scene scene = make_scene(5, false, 400);
  {
    const torch::NoGradGuard no_grad;
    scene.gaussians.logit_opacities.fill_(
        8.0);  // alpha reaches its maximum, pixels terminate early
  }
  const RenderOutput drawn = scene.drawn();
  const ReferenceImage expected = reference_render(scene.gaussians, scene.view, scene.options);
  ASSERT_GT(drawn.alpha.max().item<double>(), 0.9995);
  EXPECT_TRUE(tensors_near(drawn.color, expected.color, 1e-10));
  const auto got = torch::autograd::grad({loss_of(drawn)}, scene.leaves());
  const auto wanted = torch::autograd::grad({loss_of(expected)}, scene.leaves());
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_TRUE(tensors_near(got[i], wanted[i], 1e-6)) << kNames[i];
  }
}

TEST(RenderGradientsOfLowerDegrees, AreZeroBeyondTheEvaluatedDegree) {
  Scene scene = make_scene(2);
  scene.options.sh_degree = 1;
  const RenderOutput drawn = scene.drawn();
  const ReferenceImage expected = reference_render(scene.gaussians, scene.view, scene.options);
  EXPECT_TRUE(tensors_near(drawn.color, expected.color, 1e-10));
  const auto got = torch::autograd::grad({loss_of(drawn)}, scene.leaves());
  const auto wanted = torch::autograd::grad({loss_of(expected)}, scene.leaves());
  EXPECT_TRUE(tensors_near(got[5], wanted[5], 1e-9));
  EXPECT_EQ(got[5].slice(1, 3).abs().max().item<double>(), 0.0);
}

TEST(ScreenGradient, MatchesShiftOfCenterInHalfImageSizes) {
  const Scene scene = make_scene(4, false, 1);
  const RenderOutput drawn = scene.drawn();
  ASSERT_EQ(drawn.statistics.mean2d_gradient.abs().max().item<double>(), 0.0);
  drawn.color.sum().backward();
  // Reference: the derivative by the principal point, which shifts the projected center only.
  const auto sum_at = [&scene](double dx, double dy) {
    const torch::NoGradGuard no_grad;
    View moved = scene.view;
    moved.intrinsics.cx += dx;
    moved.intrinsics.cy += dy;
    return render(scene.gaussians, moved, scene.options).color.sum().item<double>();
  };
  const double step = 1e-5;
  const double du = (sum_at(step, 0) - sum_at(-step, 0)) / (2 * step) * 0.5 * 37;
  const double dv = (sum_at(0, step) - sum_at(0, -step)) / (2 * step) * 0.5 * 29;
  EXPECT_NEAR(drawn.statistics.mean2d_gradient.item<double>(), std::hypot(du, dv),
              1e-4 * std::hypot(du, dv));
}

}  // namespace
}  // namespace apvi::gaussians
