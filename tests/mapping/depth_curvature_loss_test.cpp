// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/depth_curvature_loss.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kHeight = 84;
constexpr std::int64_t kWidth = 112;
const auto kF64 = torch::dtype(torch::kFloat64);

/// Depth of a floor that slopes toward the camera.
Tensor floor_depth() {
  const Tensor v = torch::arange(kHeight, kF64).unsqueeze(1) / static_cast<double>(kHeight);
  const Tensor u = torch::arange(kWidth, kF64) / static_cast<double>(kWidth);
  return 1.0 / (0.3 + 0.4 * v + 0.1 * u);
}

/// The same with a floater in front of it.
Tensor with_floater() {
  Tensor depth = floor_depth();
  depth.slice(0, 20, 26).slice(1, 30, 36) *= 0.6;
  return depth;
}

Tensor solid() {
  return torch::ones({kHeight, kWidth}, kF64);
}

Tensor even_image() {
  return torch::full({kHeight, kWidth, 3}, 0.4, kF64);
}

double bent(const Tensor& depth, const Tensor& alpha, const Tensor& image) {
  return depth_curvature_loss(depth, alpha, image).item<double>();
}

TEST(DepthCurvatureLoss, IsZeroOnPlaneOfAnyOrientation) {
  EXPECT_LT(bent(floor_depth(), solid(), even_image()), 1e-12);
  EXPECT_GT(bent(with_floater(), solid(), even_image()), 1e-3);
}

TEST(DepthCurvatureLoss, IsScaleInvariant) {
  const double one = bent(with_floater(), solid(), even_image());
  EXPECT_NEAR(bent(7.0 * with_floater(), solid(), even_image()), one, 1e-9 * one);
}

TEST(DepthCurvatureLoss, IsWeakAtImageEdges) {
  Tensor image = even_image();
  image.slice(0, 20, 26).slice(1, 30, 36) += 0.3;
  const double told = bent(with_floater(), solid(), image);
  EXPECT_LT(told, 0.1 * bent(with_floater(), solid(), even_image()));
}

TEST(DepthCurvatureLoss, IgnoresEmptyPixels) {
  Tensor alpha = solid();
  alpha.slice(0, 0, 20) = 0.0;
  Tensor depth = floor_depth();
  depth.slice(0, 0, 20) = 0.0;
  EXPECT_LT(bent(depth, alpha, even_image()), 1e-9);
  EXPECT_EQ(bent(torch::zeros_like(depth), torch::zeros_like(alpha), even_image()), 0.0);
  EXPECT_EQ(bent(torch::rand({48, 64}, kF64), torch::ones({48, 64}, kF64),
                 torch::ones({48, 64, 3}, kF64)),
            0.0);
}

TEST(DepthCurvatureLoss, GradientMovesFloaterTowardSurface) {
  Tensor depth = with_floater();
  depth.requires_grad_(true);
  depth_curvature_loss(depth, solid(), even_image()).backward();
  const Tensor pull = depth.grad().slice(0, 21, 25).slice(1, 31, 35);
  EXPECT_TRUE((pull < 0.0).all().item<bool>());  // descent increases depth
}

TEST(DepthCurvatureLoss, GradientMatchesFiniteDifferences) {
  torch::manual_seed(5);
  const Tensor image = even_image() + 0.02 * torch::rand({kHeight, kWidth, 3}, kF64);
  Tensor depth = with_floater() + 0.05 * torch::rand({kHeight, kWidth}, kF64);
  depth.requires_grad_(true);
  depth_curvature_loss(depth, solid(), image).backward();
  // Small steps, so that few second differences change sign. The gradient treats the mean inverse
  // depth as constant: compare along directions that preserve it.
  const torch::NoGradGuard no_grad;
  Tensor along = torch::randn({kHeight, kWidth}, kF64);
  along -= along.mean();
  const Tensor inverse = 1.0 / depth.detach();
  const auto moved = [&](double step) { return 1.0 / (inverse + step * along); };
  const double numeric =
      (bent(moved(1e-8), solid(), image) - bent(moved(-1e-8), solid(), image)) / 2e-8;
  const double analytic = (depth.grad() * -depth.detach().square() * along).sum().item<double>();
  EXPECT_NEAR(analytic, numeric, 1e-4 * std::abs(numeric));
}

}  // namespace
}  // namespace apvi::mapping
