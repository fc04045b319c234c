// SPDX-License-Identifier: BSD-3-Clause
// Compares the CUDA backend with the CPU backend, which is tested against references.
#include <gtest/gtest.h>
#include <torch/torch.h>

#include "gaussians/metrics/loss_backend.hpp"
#include "gaussians/optimizer/adam_backend.hpp"
#include "gaussians/render/raster_backend.hpp"
#include "gaussians/render/render_scene.hpp"
#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using apvi::test::tensors_near;
using test::make_gaussians;
using test::make_view;
using test::map_tensors;
using test::raster_input;
using torch::Tensor;

constexpr std::array<const char*, 6> kNames = {"means",           "log_scales", "quaternions",
                                               "logit_opacities", "sh_dc",      "sh_rest"};

class CudaTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!torch::cuda::is_available()) GTEST_SKIP() << "no GPU that LibTorch can use";
  }
};
class CudaRaster : public CudaTest {};
class CudaLoss : public CudaTest {};
class CudaAdam : public CudaTest {};

Tensor on_gpu(const Tensor& t) {
  return t.to(torch::kCUDA, torch::kFloat32);
}
RasterInput on_gpu(const RasterInput& in) {
  RasterInput out = in;
  out.gaussians = map_tensors(in.gaussians, [](const Tensor& t) { return on_gpu(t); });
  out.background = on_gpu(in.background);
  return out;
}

RasterOutputGradient weights_for(const RasterOutput& out) {
  torch::manual_seed(3);
  const auto like = [](const Tensor& t) {
    return torch::randn(t.sizes(), torch::kFloat64).to(t.options());
  };
  return {.color = like(out.color), .depth = like(out.depth), .alpha = like(out.alpha)};
}

Tensor on_cpu(const Tensor& t) {
  return t.to(torch::kCPU, torch::kFloat64).flatten();
}
double relative_error(const Tensor& got, const Tensor& expected) {
  const double norm = on_cpu(expected).norm().item<double>();
  const double error = (on_cpu(got) - on_cpu(expected)).norm().item<double>();
  return norm > 0.0 ? error / norm : error;
}
double cosine(const Tensor& got, const Tensor& expected) {
  const double norms = on_cpu(got).norm().item<double>() * on_cpu(expected).norm().item<double>();
  return norms > 0.0 ? on_cpu(got).dot(on_cpu(expected)).item<double>() / norms : 1.0;
}

/// Images within 1e-4, except at the rims of splats, where rounding may include or exclude a pixel.
void expect_same_image(const Tensor& got, const Tensor& expected, double scale, const char* name) {
  const Tensor error = (on_cpu(got) - on_cpu(expected)).abs() / scale;
  EXPECT_LT((error > 1e-4).to(torch::kFloat64).mean().item<double>(), 2e-3) << name;
  EXPECT_LT(error.max().item<double>(), 2e-2) << name;
}

void expect_same_gradients(const RasterInputGradient& got, const RasterInputGradient& expected) {
  for (std::size_t i = 0; i < 6; ++i) {
    const Tensor& wanted = *expected.gaussians.tensors()[i];
    if (wanted.numel() == 0) continue;
    EXPECT_LT(relative_error(*got.gaussians.tensors()[i], wanted), 1e-3) << kNames[i];
    EXPECT_GT(cosine(*got.gaussians.tensors()[i], wanted), 0.9999) << kNames[i];
  }
  EXPECT_LT(relative_error(got.pose, expected.pose), 1e-3);
  EXPECT_LT(relative_error(got.background, expected.background), 1e-3);
  EXPECT_LT(relative_error(got.mean2d, expected.mean2d), 1e-3);
}

/// Forward and backward passes of both backends on one scene; the CPU in double.
void expect_parity(const Gaussians& gaussians, const View& view, bool antialiased = false) {
  const RasterInput exact = raster_input(gaussians, view, antialiased);
  const RasterInput input = on_gpu(exact);
  const RasterBackend& cpu = raster_backend(torch::kCPU);
  const RasterBackend& gpu = cuda_raster_backend();
  const RasterOutput expected = cpu.forward(exact);
  const RasterOutput got = gpu.forward(input);
  expect_same_image(got.color, expected.color, 1.0, "color");
  expect_same_image(got.alpha, expected.alpha, 1.0, "alpha");
  const double depth = std::max(expected.depth.max().item<double>(), 1.0);
  expect_same_image(got.depth, expected.depth, depth, "depth");
  EXPECT_LE((got.visible.cpu() != expected.visible).sum().item<std::int64_t>(),
            1 + gaussians.size() / 1000);
  EXPECT_LT(relative_error(got.radii_px, expected.radii_px), 1e-3);
  EXPECT_LT(relative_error(got.max_weight, expected.max_weight), 1e-3);
  const RasterOutputGradient weights = weights_for(expected);
  const RasterInputGradient wanted = cpu.backward(exact, expected, weights, false);
  const RasterInputGradient grad = gpu.backward(input, got,
                                                {.color = on_gpu(weights.color),
                                                 .depth = on_gpu(weights.depth),
                                                 .alpha = on_gpu(weights.alpha)},
                                                false);
  expect_same_gradients(grad, wanted);
}

TEST_F(CudaRaster, ForwardAndBackwardMatchCpuInDouble) {
  for (int degree = 0; degree <= 3; ++degree) {
    SCOPED_TRACE(degree);
    expect_parity(make_gaussians(700, torch::kFloat64, degree), make_view(117, 83),
                  degree % 2 == 1);
  }
}

TEST_F(CudaRaster, MatchesCpuWithManyTilesAndSplats) {
  Gaussians many = make_gaussians(40000);
  many.log_scales -= 1.5;
  expect_parity(many, make_view(640, 480));
}

TEST_F(CudaRaster, MatchesCpuForSplatsCoveringTheImage) {
  Gaussians huge = make_gaussians(60);
  huge.log_scales += 2.0;
  huge.logit_opacities -= 2.0;
  expect_parity(huge, make_view(640, 480));
}

TEST_F(CudaRaster, MatchesCpuWithEarlyTermination) {
  Gaussians fog = make_gaussians(4000);
  fog.logit_opacities += 4.0;
  expect_parity(fog, make_view(117, 83));
}

TEST_F(CudaRaster, MatchesCpuForOnePixelAndPartialTiles) {
  for (const auto& [width, height] : {std::pair(1, 1), std::pair(17, 1), std::pair(33, 47)}) {
    SCOPED_TRACE(width);
    View view = make_view(64, 48);
    view.intrinsics = view.intrinsics.scaled(width, height);
    expect_parity(make_gaussians(50), view);
  }
}

TEST_F(CudaRaster, MatchesCpuWithMoreTilesThan16BitKeys) {
  const Gaussians some = make_gaussians(30, torch::kFloat64, 0);
  View view = make_view(4352, 3900);  // 272 x 244 tiles
  const RasterInput exact = raster_input(some, view);
  const RasterOutput expected = raster_backend(torch::kCPU).forward(exact);
  const RasterOutput got = cuda_raster_backend().forward(on_gpu(exact));
  expect_same_image(got.color, expected.color, 1.0, "color");
}

TEST_F(CudaRaster, ImagesOnlyIsBitwiseIdentical) {
  Gaussians many = make_gaussians(40000);
  many.log_scales -= 1.5;
  Gaussians fog = make_gaussians(6000);  // tiles of many chunks, terminated early
  fog.logit_opacities += 2.0;
  for (const Gaussians& scene : {many, fog, make_gaussians(3)}) {
    for (const auto& [width, height] : {std::pair(640, 480), std::pair(117, 83)}) {
      SCOPED_TRACE(width);
      RasterInput input = on_gpu(raster_input(scene, make_view(width, height)));
      const RasterOutput full = cuda_raster_backend().forward(input);
      input.images_only = true;
      const RasterOutput images = cuda_raster_backend().forward(input);
      EXPECT_TRUE(torch::equal(images.color, full.color));
      EXPECT_TRUE(torch::equal(images.depth, full.depth));
      EXPECT_TRUE(torch::equal(images.alpha, full.alpha));
      EXPECT_FALSE(images.visible.defined());
      EXPECT_TRUE(images.state.empty());
    }
  }
}

TEST_F(CudaRaster, SortsByDepthAtAnyScale) {
  const View view = make_view(117, 83);
  for (const double near_m : {0.01, 1e-5}) {
    for (const double scale : {0.02, 1.0, 300.0, 3e4}) {
      SCOPED_TRACE(scale);
      Gaussians scene = make_gaussians(700);
      scene.means *= scale;
      scene.log_scales += std::log(scale);
      View scaled = view;
      scaled.T_camera_world = view.T_camera_world.clone();
      scaled.T_camera_world.slice(0, 0, 3).select(1, 3).mul_(scale);
      RasterInput exact = raster_input(scene, scaled);
      exact.near_m = near_m;
      const RasterOutput expected = raster_backend(torch::kCPU).forward(exact);
      const RasterOutput got = cuda_raster_backend().forward(on_gpu(exact));
      expect_same_image(got.color, expected.color, 1.0, "color");
    }
  }
}

TEST_F(CudaRaster, IsDeterministic) {
  const RasterInput input = on_gpu(raster_input(make_gaussians(5000), make_view(320, 240)));
  const auto both = [&] {
    const RasterOutput out = cuda_raster_backend().forward(input);
    return std::pair(out, cuda_raster_backend().backward(input, out, weights_for(out), false));
  };
  const auto [first, first_gradient] = both();
  const auto [second, second_gradient] = both();
  EXPECT_TRUE(torch::equal(first.color, second.color));
  EXPECT_TRUE(torch::equal(first.max_weight, second.max_weight));
  EXPECT_TRUE(torch::equal(first_gradient.pose, second_gradient.pose));
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_TRUE(torch::equal(*first_gradient.gaussians.tensors()[i],
                             *second_gradient.gaussians.tensors()[i]))
        << kNames[i];
  }
}

TEST_F(CudaRaster, ReallocatesWhenTheNextImageNeedsMoreMemory) {
  const View view = make_view(320, 240);
  const RasterInput large = on_gpu(raster_input(make_gaussians(60000), view));
  const RasterInput small = on_gpu(raster_input(make_gaussians(3), view));
  const RasterOutput before = cuda_raster_backend().forward(large);
  for (int i = 0; i < 3; ++i) cuda_raster_backend().forward(small);
  EXPECT_TRUE(torch::equal(cuda_raster_backend().forward(large).color, before.color));
}

TEST_F(CudaRaster, GradientsBeyondTheEvaluatedDegreeAreZero) {
  RasterInput input = on_gpu(raster_input(make_gaussians(300), make_view(117, 83)));
  input.sh_degree = 1;
  const RasterOutput out = cuda_raster_backend().forward(input);
  const Tensor by_rest =
      cuda_raster_backend().backward(input, out, weights_for(out), false).gaussians.sh_rest;
  EXPECT_GT(by_rest.slice(1, 0, 3).abs().max().item<double>(), 0.0);
  EXPECT_EQ(by_rest.slice(1, 3).abs().max().item<double>(), 0.0);
}

LossInput loss_input(std::int64_t height, std::int64_t width, bool masked) {
  torch::manual_seed(11);
  const auto f64 = torch::dtype(torch::kFloat64);
  const Tensor target = torch::rand({height, width, 3}, f64);
  return {.image = (target + 0.1 * torch::randn({height, width, 3}, f64)).clamp(0.0, 1.0),
          .target = target,
          .valid = masked ? (torch::rand({height, width}, f64) > 0.3).to(f64) : Tensor(),
          .ssim_weight = 0.2};
}

TEST_F(CudaLoss, ForwardAndBackwardMatchCpuInDouble) {
  for (const bool masked : {false, true}) {
    for (const auto& [height, width] : {std::pair(3, 5), std::pair(61, 83), std::pair(480, 640)}) {
      SCOPED_TRACE(width);
      const LossInput exact = loss_input(height, width, masked);
      LossInput input = exact;
      input.image = on_gpu(exact.image);
      input.target = on_gpu(exact.target);
      if (masked) input.valid = on_gpu(exact.valid);
      const LossOutput expected = cpu_loss_backend().forward(exact, true);
      const LossOutput got = cuda_loss_backend().forward(input, true);
      EXPECT_NEAR(got.loss.item<double>(), expected.loss.item<double>(), 1e-5);
      const Tensor grad_loss = torch::tensor(0.7, torch::kFloat64);
      const Tensor wanted = cpu_loss_backend().backward(exact, expected.saved, grad_loss);
      const Tensor gradient = cuda_loss_backend().backward(input, got.saved, on_gpu(grad_loss));
      EXPECT_LT(relative_error(gradient, wanted), 1e-3);
      EXPECT_TRUE(torch::equal(gradient,
                               cuda_loss_backend().backward(input, got.saved, on_gpu(grad_loss))));
    }
  }
}

TEST_F(CudaLoss, IsZeroWithoutValidPixels) {
  LossInput input = loss_input(20, 30, false);
  input.image = on_gpu(input.image);
  input.target = on_gpu(input.target);
  input.valid = torch::zeros({20, 30}, input.image.options());
  const LossOutput got = cuda_loss_backend().forward(input, true);
  EXPECT_EQ(got.loss.item<double>(), 0.0);
  EXPECT_EQ(cuda_loss_backend()
                .backward(input, got.saved, torch::ones_like(got.loss))
                .abs()
                .max()
                .item<double>(),
            0.0);
}

AdamGroup adam_group(const std::vector<std::int64_t>& shape, double rate) {
  return {.parameter = torch::randn(shape, torch::kFloat64),
          .gradient = torch::randn(shape, torch::kFloat64),
          .first = torch::randn(shape, torch::kFloat64) * 0.1,
          .second = torch::rand(shape, torch::kFloat64) * 0.1,
          .rate = rate};
}

TEST_F(CudaAdam, MatchesCpuInDouble) {
  torch::manual_seed(5);
  const Tensor visible = torch::rand({1001}) > 0.5;
  for (const bool masked : {false, true}) {
    std::vector<AdamGroup> exact = {adam_group({1001, 3}, 0.1), adam_group({1001}, 0.02),
                                    adam_group({1001, 15, 3}, 0.3), adam_group({1001, 4}, 0.1)};
    std::vector<AdamGroup> groups;
    for (const AdamGroup& g : exact) {
      groups.push_back(
          {on_gpu(g.parameter), on_gpu(g.gradient), on_gpu(g.first), on_gpu(g.second), g.rate});
    }
    const Tensor mask = masked ? visible : Tensor();
    cpu_adam_backend().step(exact, 7, {}, mask);
    cuda_adam_backend().step(groups, 7, {}, masked ? mask.to(torch::kCUDA) : Tensor());
    for (std::size_t k = 0; k < exact.size(); ++k) {
      EXPECT_TRUE(tensors_near(groups[k].parameter.cpu(), exact[k].parameter, 1e-5)) << k;
      EXPECT_TRUE(tensors_near(groups[k].first.cpu(), exact[k].first, 1e-6)) << k;
      EXPECT_TRUE(tensors_near(groups[k].second.cpu(), exact[k].second, 1e-6)) << k;
    }
  }
}

std::vector<AdamGroup> groups_of(const Gaussians& map, const Gaussians& gradient) {
  torch::manual_seed(8);
  std::vector<AdamGroup> out;
  for (std::size_t k = 0; k < 6; ++k) {
    const Tensor& parameter = *map.tensors()[k];
    out.push_back({.parameter = parameter.clone(),
                   .gradient = *gradient.tensors()[k],
                   .first = torch::randn_like(parameter) * 0.1,
                   .second = torch::rand_like(parameter) * 0.1,
                   .rate = 0.01 * static_cast<double>(k + 1)});
  }
  return out;
}

TEST_F(CudaAdam, SparseStepMatchesDenseStep) {
  for (const auto& [degree, used] : {std::pair(3, 3), std::pair(3, 1), std::pair(0, 0)}) {
    for (const bool visible_only : {false, true}) {
      SCOPED_TRACE(degree + 10 * used);
      Gaussians some = make_gaussians(1003, torch::kFloat64, degree);
      some.means.slice(0, 0, 200).select(1, 2).mul_(-1.0);  // behind the camera
      RasterInput input = on_gpu(raster_input(some, make_view(117, 83)));
      input.sh_degree = used;
      const RasterBackend& raster = cuda_raster_backend();
      const RasterOutput out = raster.forward(input);
      const RasterInputGradient dense = raster.backward(input, out, weights_for(out), false);
      const RasterInputGradient sparse = raster.backward(input, out, weights_for(out), true);
      std::vector<AdamGroup> expected = groups_of(input.gaussians, dense.gaussians);
      std::vector<AdamGroup> got = groups_of(input.gaussians, dense.gaussians);
      adam_step(expected, 7, {}, visible_only ? out.visible : Tensor());
      adam_step_sparse(got, sparse.sparse, 7, {}, visible_only);
      EXPECT_TRUE(torch::equal(dense.mean2d, sparse.mean2d));
      for (std::size_t k = 0; k < 6; ++k) {
        if (got[k].parameter.numel() == 0) continue;
        EXPECT_TRUE(tensors_near(got[k].parameter, expected[k].parameter, 1e-6)) << kNames[k];
        EXPECT_TRUE(tensors_near(got[k].first, expected[k].first, 1e-6)) << kNames[k];
        EXPECT_TRUE(tensors_near(got[k].second, expected[k].second, 1e-6)) << kNames[k];
      }
    }
  }
}

Tensor zero_moment(const Tensor& parameter, bool bf16) {
  return torch::zeros_like(parameter,
                           parameter.options().dtype(bf16 ? torch::kBFloat16 : torch::kFloat32));
}

/// Mean squared error after optimization with noisy gradients.
double optimize_noisily(bool bf16, Tensor& parameter) {
  torch::manual_seed(4);
  const Tensor wanted = torch::randn({30000}, torch::kCUDA);
  parameter = torch::zeros_like(wanted);
  AdamGroup group = {.parameter = parameter,
                     .gradient = {},
                     .first = zero_moment(parameter, bf16),
                     .second = zero_moment(parameter, bf16),
                     .rate = 0.01};
  for (int step = 1; step <= 1500; ++step) {
    group.gradient = parameter - wanted + torch::randn_like(wanted);
    adam_step({group}, step);
  }
  return (parameter - wanted).square().mean().item<double>();
}

TEST_F(CudaAdam, ConvergesEquallyWithBFloat16Moments) {
  Tensor parameter;
  const double full = optimize_noisily(false, parameter);
  const double bf16 = optimize_noisily(true, parameter);
  EXPECT_LT(full, 0.05);
  EXPECT_NEAR(bf16, full, 0.02 * full);
  const Tensor before = parameter;
  optimize_noisily(true, parameter);
  EXPECT_TRUE(torch::equal(parameter, before));
}

TEST_F(CudaAdam, BFloat16MomentsAreUnbiased) {
  const Tensor gradient = torch::full({100000}, 0.3, torch::kCUDA);
  const Tensor parameter = torch::zeros_like(gradient);
  const AdamGroup group = {.parameter = parameter,
                           .gradient = gradient,
                           .first = zero_moment(parameter, true),
                           .second = zero_moment(parameter, true),
                           .rate = 1e-3};
  constexpr int kSteps = 700;
  for (int step = 1; step <= kSteps; ++step) adam_step({group}, step);
  const double second = 0.09 * (1.0 - std::pow(0.999, kSteps));
  EXPECT_NEAR(group.first.to(torch::kFloat64).mean().item<double>(), 0.3, 1e-3);
  EXPECT_NEAR(group.second.to(torch::kFloat64).mean().item<double>(), second, 1e-3 * second);
}

}  // namespace
}  // namespace apvi::gaussians
