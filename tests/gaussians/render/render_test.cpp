// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/render/render.hpp"

#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

#include "gaussians/render/raster_backend.hpp"
#include "gaussians/render/render_scene.hpp"
#include "support/torch_raster.hpp"
#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using apvi::test::tensors_near;
using test::make_gaussians;
using test::make_view;
using test::map_tensors;
using test::raster_input;
using torch::Tensor;

Gaussians leaves_of(const Gaussians& from) {
  return map_tensors(from, [](const Tensor& t) { return t.detach().clone().requires_grad_(true); });
}

/// Gradients with respect to the six tensors of a weighted sum of colors.
std::vector<Tensor> gradients(const Gaussians& gaussians, const View& view,
                              const RenderOptions& options = {}) {
  const Gaussians leaves = leaves_of(gaussians);
  const RenderOutput drawn = render(leaves, view, options);
  torch::manual_seed(3);
  const Tensor weights =
      torch::randn(drawn.color.sizes(), torch::kFloat64).to(drawn.color.options());
  ((weights * drawn.color).sum() + drawn.depth.sum()).backward();
  std::vector<Tensor> out;
  for (const Tensor* tensor : leaves.tensors()) out.push_back(tensor->grad());
  return out;
}

TEST(Render, SingleSplatMatchesAnalyticGaussian) {
  const auto f64 = torch::dtype(torch::kFloat64);
  const Gaussians one = {.means = torch::tensor({{0.0, 0.0, 2.0}}, f64),
                         .log_scales = torch::full({1, 3}, std::log(0.1), f64),
                         .quaternions = torch::tensor({{1.0, 0.0, 0.0, 0.0}}, f64),
                         .logit_opacities = torch::zeros({1}, f64),
                         .sh_dc = torch::zeros({1, 3}, f64),
                         .sh_rest = torch::zeros({1, 0, 3}, f64)};
  const View view = {
      .intrinsics = {.fx = 40, .fy = 40, .cx = 10.5, .cy = 10.5, .width = 21, .height = 21},
      .T_camera_world = torch::eye(4, f64),
      .pose_delta = {}};
  const RenderOutput drawn = render(one, view, {});
  // 40 px * 0.1 m / 2 m = 2 px, and the low-pass: variance 4.3 px².
  EXPECT_NEAR(drawn.alpha[10][10].item<double>(), 0.5, 1e-12);
  EXPECT_NEAR(drawn.alpha[10][13].item<double>(), 0.5 * std::exp(-0.5 * 9.0 / 4.3), 1e-12);
  EXPECT_NEAR(drawn.color[12][13][1].item<double>(), 0.25 * std::exp(-0.5 * 13.0 / 4.3), 1e-12);
  EXPECT_NEAR(drawn.depth[10][13].item<double>(), 2.0, 1e-12);
  EXPECT_EQ(drawn.depth[0][0].item<double>(), 0.0);
  EXPECT_NEAR(drawn.statistics.max_weight.item<double>(), 0.5, 1e-12);
  EXPECT_NEAR(drawn.statistics.radii_px.item<double>(), std::sqrt(4.3 * 2 * std::log(127.5)), 1e-2);
  EXPECT_TRUE(drawn.statistics.visible.item<bool>());
}

TEST(Render, IsInvariantToRigidMotionOfCameraAndScene) {
  const Gaussians before = make_gaussians(80, torch::kFloat64, 0);
  const View view = make_view();
  const auto f64 = torch::dtype(torch::kFloat64);
  const Tensor turn = torch::tensor({{0.3, -0.5, 0.7, 0.4}}, f64);
  const Tensor R = apvi::test::reference_rotations(turn)[0];
  const Tensor shift = torch::tensor({3.0, -2.0, 5.0}, f64);
  Gaussians after = before;
  after.means = before.means.matmul(R.t()) + shift;
  const auto a = (turn / turn.norm()).unbind(1);
  const auto b = before.quaternions.unbind(1);
  after.quaternions = torch::stack({a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
                                    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
                                    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
                                    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]},
                                   1);
  Tensor motion = torch::eye(4, f64);
  motion.slice(0, 0, 3).slice(1, 0, 3).copy_(R);
  motion.slice(0, 0, 3).select(1, 3).copy_(shift);
  View moved = view;
  moved.T_camera_world = view.T_camera_world.matmul(torch::inverse(motion));
  const RenderOutput x = render(before, view, {});
  const RenderOutput y = render(after, moved, {});
  EXPECT_TRUE(tensors_near(y.color, x.color, 1e-9));
  EXPECT_TRUE(tensors_near(y.depth, x.depth, 1e-9));
}

TEST(Render, IsIndependentOfGaussianOrder) {
  const Gaussians before = make_gaussians(200, torch::kFloat32);
  const Tensor order = torch::randperm(200);
  const Gaussians after =
      map_tensors(before, [&](const Tensor& t) { return t.index_select(0, order); });
  const View view = make_view();
  EXPECT_TRUE(tensors_near(render(after, view, {}).color, render(before, view, {}).color, 1e-6));
  const auto x = gradients(before, view);
  const auto y = gradients(after, view);
  for (std::size_t i = 0; i < x.size(); ++i) {
    EXPECT_TRUE(tensors_near(y[i], x[i].index_select(0, order), 1e-6)) << "tensor " << i;
  }
}

TEST(Render, EqualDepthsAreBlendedByIndex) {
  Gaussians two = map_tensors(make_gaussians(1, torch::kFloat32, 0), [](const Tensor& t) {
    return torch::cat({t, t});
  });
  two.logit_opacities.fill_(2.0);
  two.sh_dc.copy_(torch::tensor({{1.0F, 0.0F, 0.0F}, {0.0F, 0.0F, 1.0F}}));
  const Tensor weights = render(two, make_view(), {}).statistics.max_weight;
  EXPECT_GT(weights[0].item<float>(), 3.0F * weights[1].item<float>());
}

TEST(Render, IsBitwiseIdenticalForAnyThreadCount) {
  const Gaussians gaussians = make_gaussians(5000, torch::kFloat32);
  const View view = make_view(203, 117);
  const int threads = at::get_num_threads();
  at::set_num_threads(1);
  const RenderOutput alone = render(gaussians, view, {});
  const auto x = gradients(gaussians, view);
  at::set_num_threads(3);
  const RenderOutput together = render(gaussians, view, {});
  const auto y = gradients(gaussians, view);
  at::set_num_threads(threads);
  EXPECT_TRUE(torch::equal(alone.color, together.color));
  EXPECT_TRUE(torch::equal(alone.depth, together.depth));
  EXPECT_TRUE(torch::equal(alone.statistics.max_weight, together.statistics.max_weight));
  for (std::size_t i = 0; i < x.size(); ++i)
    EXPECT_TRUE(torch::equal(x[i], y[i])) << "tensor " << i;
}

TEST(Render, NearPlaneCullsCloserGaussians) {
  const Gaussians gaussians = make_gaussians(50, torch::kFloat64);
  RenderOptions far;
  far.near_m = 4.0;
  const RenderOutput drawn = render(gaussians, make_view(), far);
  const Tensor hit = drawn.alpha > 0;
  ASSERT_TRUE(hit.any().item<bool>());
  EXPECT_GE(drawn.depth.index({hit}).min().item<double>(), 4.0);
  EXPECT_TRUE(tensors_near(drawn.color,
                           apvi::test::reference_render(gaussians, make_view(), far).color, 1e-10));
}

TEST(Render, MaxWeightIsLargestBlendWeightOverPixels) {
  const Gaussians gaussians = make_gaussians(60, torch::kFloat64);
  const View view = make_view();
  const auto expected = apvi::test::reference_render(gaussians, view, {});
  const RenderOutput drawn = render(gaussians, view, {});
  const auto by_size = [](const Tensor& t) { return std::get<0>(t.sort(0, true)).slice(0, 0, 40); };
  EXPECT_TRUE(
      tensors_near(by_size(drawn.statistics.max_weight), by_size(expected.max_weight), 1e-10));
}

TEST(Render, DoesNotRequireGradWithoutInputGradients) {
  const RenderOutput drawn = render(make_gaussians(10, torch::kFloat32), make_view(), {});
  EXPECT_FALSE(drawn.color.requires_grad());
}

TEST(Render, NoGradModeRendersIdenticalImagesOnly) {
  const Gaussians leaves = map_tensors(make_gaussians(300, torch::kFloat32),
                                       [](const Tensor& t) { return t.requires_grad_(true); });
  const RenderOutput whole = render(leaves, make_view(117, 83), {});
  const torch::NoGradGuard no_grad;
  const RenderOutput images =
      render(leaves, make_view(117, 83), {.background = {}, .sparse_gradient = true});
  EXPECT_TRUE(torch::equal(images.color, whole.color));
  EXPECT_TRUE(torch::equal(images.depth, whole.depth));
  EXPECT_TRUE(torch::equal(images.alpha, whole.alpha));
  EXPECT_FALSE(images.color.requires_grad());
  EXPECT_FALSE(images.statistics.visible.defined() || images.statistics.max_weight.defined());
  EXPECT_TRUE(whole.statistics.max_weight.defined());
}

TEST(Render, PosePerturbationIsLeftMultiplied) {
  const Gaussians gaussians = make_gaussians(40);
  View perturbed = make_view();
  perturbed.pose_delta = torch::tensor({0.1, -0.2, 0.05, 0.02, 0.3, -0.1}, torch::kFloat64);
  View composed = make_view();
  composed.T_camera_world = apvi::test::reference_pose(perturbed);
  EXPECT_TRUE(tensors_near(render(gaussians, perturbed, {}).color,
                           render(gaussians, composed, {}).color, 1e-12));
}

TEST(DepthToRange, MultipliesDepthByRayLength) {
  const Intrinsics k = {.fx = 10, .fy = 20, .cx = 3.5, .cy = 2.0, .width = 8, .height = 5};
  const Tensor range = depth_to_range(torch::full({5, 8}, 2.0, torch::kFloat64), k);
  const double x = (7 + 0.5 - 3.5) / 10;
  const double y = (4 + 0.5 - 2.0) / 20;
  EXPECT_NEAR(range[4][7].item<double>(), 2 * std::sqrt(1 + x * x + y * y), 1e-12);
  EXPECT_THROW(depth_to_range(torch::ones({8, 5}), k), c10::Error);
}

/// Every CPU instruction set supported by this processor.
class RasterBackends : public testing::TestWithParam<const RasterBackend*> {};

RasterOutputGradient ones_like(const RasterOutput& out) {
  return {torch::ones_like(out.color), torch::ones_like(out.depth), torch::ones_like(out.alpha)};
}

TEST_P(RasterBackends, FloatAgreesWithDouble) {
  const Gaussians exact = make_gaussians(700);
  const Gaussians rough = map_tensors(exact, [](const Tensor& t) { return t.to(torch::kFloat32); });
  const View view = make_view(117, 83);
  const RasterInput in64 = raster_input(exact, view, true);
  const RasterInput in32 = raster_input(rough, view, true);
  const RasterOutput out64 = GetParam()->forward(in64);
  const RasterOutput out32 = GetParam()->forward(in32);
  // A pixel at the rim of a splat may be included in one and not in the other: 1/255 at most.
  EXPECT_LT((out32.color - out64.color).abs().max().item<double>(), 1e-2);
  EXPECT_LT((out32.color - out64.color).square().mean().sqrt().item<double>(), 5e-5);
  EXPECT_LT((out32.alpha - out64.alpha).square().mean().sqrt().item<double>(), 5e-5);
  const RasterInputGradient g64 = GetParam()->backward(in64, out64, ones_like(out64), false);
  const RasterInputGradient g32 = GetParam()->backward(in32, out32, ones_like(out32), false);
  for (std::size_t i = 0; i < 6; ++i) {
    const Tensor& expected = *g64.gaussians.tensors()[i];
    const double error = (*g32.gaussians.tensors()[i] - expected).norm().item<double>();
    EXPECT_LT(error, 2e-3 * expected.norm().item<double>()) << "tensor " << i;
  }
  EXPECT_TRUE(tensors_near(g32.pose, g64.pose, 1e-3));
  EXPECT_TRUE(tensors_near(g32.background, g64.background, 1e-4));
}

INSTANTIATE_TEST_SUITE_P(Here, RasterBackends, testing::ValuesIn(cpu_raster_backends()),
                         [](const auto& backend) {
                           std::string name(backend.param->name());
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

}  // namespace
}  // namespace apvi::gaussians
