// SPDX-License-Identifier: BSD-3-Clause
// The CUDA step backend against LibTorch operators on the CPU.
#include "mapping/training/step_backend.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

#include "mapping/depth_curvature_loss.hpp"
#include "mapping/medium/open_water.hpp"
#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using apvi::test::tensors_near;
using torch::Tensor;

constexpr std::int64_t kHeight = 101;
constexpr std::int64_t kWidth = 133;

class CudaStep : public testing::Test {
 protected:
  void SetUp() override {
    if (!torch::cuda::is_available()) GTEST_SKIP() << "no GPU that LibTorch can use";
    torch::manual_seed(11);
  }
  static Tensor on_gpu(const Tensor& t) { return t.defined() ? t.to(torch::kCUDA) : t; }
  const StepBackend& cpu_ = step_backend(torch::kCPU);
  const StepBackend& gpu_ = step_backend(torch::kCUDA);
};

TEST_F(CudaStep, TargetMatchesOperators) {
  const Tensor image = torch::randint(0, 256, {kHeight, kWidth, 3}, torch::kUInt8);
  const Tensor log_gain = torch::full({1}, 0.3);
  for (const int reduction : {1, 2, 4}) {
    const Tensor falloff = 0.3 + torch::rand({kHeight / reduction, kWidth / reduction, 1});
    for (const auto& [lens, gain] : {std::pair(Tensor(), Tensor()), std::pair(falloff, Tensor()),
                                     std::pair(falloff, log_gain)}) {
      const Tensor expected =
          cpu_.target({.image = image, .reduction = reduction, .falloff = lens, .log_gain = gain});
      const Tensor got = gpu_.target({.image = on_gpu(image),
                                      .reduction = reduction,
                                      .falloff = on_gpu(lens),
                                      .log_gain = on_gpu(gain)});
      EXPECT_TRUE(tensors_near(got.cpu(), expected, 1e-6)) << "reduced " << reduction;
    }
  }
}

TEST_F(CudaStep, GainUpdateMatchesOperators) {
  const Tensor drawn = torch::rand({kHeight, kWidth, 3});
  const Tensor alpha = torch::rand({kHeight, kWidth});
  const auto matched = [&](const StepBackend& backend, const torch::Device& device,
                           const Tensor& image, const Tensor& solid) {
    const Tensor log_gain = torch::full({1}, 0.1, device);
    const Tensor bias = torch::full({1}, 0.02, device);
    backend.match_gain({.drawn = drawn.to(device),
                        .alpha = solid.to(device),
                        .image = image.to(device),
                        .water = {},
                        .log_gain = log_gain,
                        .bias = bias,
                        .update = kKnownViewGainUpdate});
    return log_gain.cpu().item<double>();
  };
  const Tensor darker = 0.8 * drawn;
  const double expected = matched(cpu_, torch::kCPU, darker, alpha);
  ASSERT_LT(expected, 0.09);
  EXPECT_NEAR(matched(gpu_, torch::kCUDA, darker, alpha), expected, 1e-6);
  EXPECT_EQ(matched(gpu_, torch::kCUDA, darker, alpha), matched(gpu_, torch::kCUDA, darker, alpha));
  const Tensor hardly_solid = 0.55 * alpha;  // 9 % of the pixels: not enough
  EXPECT_FLOAT_EQ(static_cast<float>(matched(gpu_, torch::kCUDA, darker, hardly_solid)), 0.1F);
}

TEST_F(CudaStep, OpenWaterGainUpdateMatchesOperators) {
  const Tensor water = torch::tensor({0.1F, 0.5F, 0.95F}).expand({kHeight, kWidth, 3}).contiguous();
  const Tensor drawn = torch::rand({kHeight, kWidth, 3});
  Tensor alpha = torch::ones({kHeight, kWidth});
  alpha.narrow(0, 0, kHeight / 3).zero_();
  Tensor image = drawn.clone();
  image.narrow(0, 0, kHeight / 3).copy_((1.1 * water.narrow(0, 0, kHeight / 3)).clamp_max(1.0));
  const auto matched = [&](const StepBackend& backend, const torch::Device& device,
                           const Tensor& open, const Horizon& horizon) {
    const Tensor log_gain = torch::zeros({1}, device);
    const Tensor bias = torch::zeros({1}, device);
    backend.match_gain({.drawn = drawn.to(device),
                        .alpha = alpha.to(device),
                        .image = image.to(device),
                        .water = open.defined() ? open.to(device) : open,
                        .horizon = horizon,
                        .log_gain = log_gain,
                        .bias = bias,
                        .update = kNewViewGainUpdate});
    return log_gain.cpu().item<double>();
  };
  const double without = matched(cpu_, torch::kCPU, Tensor(), kNoSky);
  const double expected = matched(cpu_, torch::kCPU, water, kNoSky);
  ASSERT_GT(expected, without + 0.01);
  EXPECT_NEAR(matched(gpu_, torch::kCUDA, water, kNoSky), expected, 1e-6);
  alpha.fill_(1.0);  // covered by the map
  const Horizon slanted{0.1F, -1.0F, 30.0F};
  const double hidden = matched(cpu_, torch::kCPU, water, slanted);
  ASSERT_GT(hidden, matched(cpu_, torch::kCPU, water, kNoSky) + 0.01);
  EXPECT_NEAR(matched(gpu_, torch::kCUDA, water, slanted), hidden, 1e-6);
}

TEST_F(CudaStep, OpacityLossGradientMatchesOperators) {
  const Tensor across = torch::linspace(0.2, 0.5, kWidth).view({1, kWidth, 1});
  const Tensor water = across.expand({kHeight, kWidth, 3});
  Tensor image = water + 0.01 * torch::randn({kHeight, kWidth, 3});
  image.slice(0, 20, 50) += 0.1 * torch::randn({30, kWidth, 3});
  image.slice(1, 90) += 0.05;
  const Tensor expected = cpu_.classify_water(image, water);
  const Tensor got = gpu_.classify_water(on_gpu(image), on_gpu(water)).cpu();
  const auto share = [](const Tensor& which) {
    return which.to(torch::kFloat64).mean().item<double>();
  };
  for (const int kind : {-1, 0, 1}) ASSERT_GT(share(expected == kind), 0.05) << kind;
  EXPECT_GT(share(got == expected), 0.9999);
  const Tensor alpha = torch::rand({kHeight, kWidth});
  const Tensor pull = cpu_.opacity_loss_gradient(image, water, alpha, kDaylightOpacityWeights);
  const Tensor on_device = gpu_.opacity_loss_gradient(on_gpu(image), on_gpu(water), on_gpu(alpha),
                                                      kDaylightOpacityWeights)
                               .cpu();
  EXPECT_GT(share((on_device - pull).abs() < 1e-10), 0.999);
}

TEST_F(CudaStep, DensitySumsMatchOperators) {
  constexpr std::int64_t kCount = 1000;
  const gaussians::RenderStatistics seen = {.visible = torch::rand({kCount}) > 0.5,
                                            .radii_px = {},
                                            .max_weight = torch::rand({kCount}),
                                            .mean2d_gradient = torch::rand({kCount})};
  const DensitySums sums = {.gradient = torch::rand({kCount}),
                            .views = torch::ones({kCount}),
                            .max_weight = torch::rand({kCount})};
  const DensitySums on_device = {.gradient = on_gpu(sums.gradient),
                                 .views = on_gpu(sums.views),
                                 .max_weight = on_gpu(sums.max_weight)};
  cpu_.observe(seen, sums);
  gpu_.observe({.visible = on_gpu(seen.visible),
                .radii_px = {},
                .max_weight = on_gpu(seen.max_weight),
                .mean2d_gradient = on_gpu(seen.mean2d_gradient)},
               on_device);
  EXPECT_TRUE(tensors_near(on_device.gradient.cpu(), sums.gradient, 1e-6));
  EXPECT_TRUE(torch::equal(on_device.views.cpu(), sums.views));
  EXPECT_TRUE(torch::equal(on_device.max_weight.cpu(), sums.max_weight));
}

TEST_F(CudaStep, DepthCurvatureLossAndGradientMatchOperatorsInDouble) {
  const auto f64 = torch::dtype(torch::kFloat64);
  const Tensor image = 0.4 + 0.1 * torch::rand({kHeight, kWidth, 3}, f64);
  const Tensor alpha = torch::rand({kHeight, kWidth}, f64) + 0.47;
  Tensor depth = 1.0 + torch::rand({kHeight, kWidth}, f64);
  depth.slice(0, 0, 10) = 0.0;
  depth.requires_grad_(true);
  const Tensor expected = depth_curvature_loss(depth, alpha, image);
  (3.0 * expected).backward();
  ASSERT_GT(expected.item<double>(), 1e-3);
  const auto single = [&](const Tensor& t) { return on_gpu(t.detach().to(torch::kFloat32)); };
  const Tensor on_device = single(depth).requires_grad_(true);
  const Tensor got = depth_curvature_loss(on_device, single(alpha), single(image));
  (3.0 * got).backward();
  EXPECT_NEAR(got.cpu().item<double>() / expected.item<double>(), 1.0, 1e-4);
  const Tensor difference = on_device.grad().cpu().to(torch::kFloat64) - depth.grad();
  EXPECT_LT((difference.norm() / depth.grad().norm()).item<double>(), 1e-3);
}

}  // namespace
}  // namespace apvi::mapping
