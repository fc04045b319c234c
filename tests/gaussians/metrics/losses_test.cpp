// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/metrics/losses.hpp"

#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <torch/torch.h>

#include <array>

#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using test::numeric_gradient;
using test::tensors_near;
using torch::Tensor;

/// Reference SSIM of every value with full two-dimensional windows and zero padding.
Tensor ssim_map(const Tensor& image, const Tensor& target) {
  const Tensor offsets = torch::arange(-5, 6, image.options());
  const Tensor line = torch::exp(-offsets.square() / (2.0 * 1.5 * 1.5));
  const Tensor taps = line / line.sum();
  const Tensor window = torch::outer(taps, taps).reshape({1, 1, 11, 11});
  const auto blur = [&](const Tensor& t) {
    return torch::conv2d(t.permute({2, 0, 1}).unsqueeze(1), window, {}, 1, 5)
        .squeeze(1)
        .permute({1, 2, 0});
  };
  const Tensor x = blur(image);
  const Tensor y = blur(target);
  const Tensor xx = blur(image * image) - x * x;
  const Tensor yy = blur(target * target) - y * y;
  const Tensor xy = blur(image * target) - x * y;
  return (2.0 * x * y + 1e-4) * (2.0 * xy + 9e-4) / ((x * x + y * y + 1e-4) * (xx + yy + 9e-4));
}

Tensor reference_loss(const Tensor& image, const Tensor& target, double ssim_weight,
                      const Tensor& valid = {}) {
  if (!valid.defined()) {
    return (1.0 - ssim_weight) * (image - target).abs().mean() +
           ssim_weight * (1.0 - ssim_map(image, target).mean());
  }
  const Tensor weight = valid.to(image.scalar_type()).unsqueeze(-1);
  const Tensor seen = torch::where(weight > 0.5, image, target);
  const Tensor count = 3.0 * weight.sum();
  return (1.0 - ssim_weight) * (seen - target).abs().sum() / count +
         ssim_weight * (1.0 - (weight * ssim_map(seen, target)).sum() / count);
}

struct Pair {
  Tensor image, target;
};

/// A smooth image with noise and a noisy rendering of it.
Pair make_pair(std::int64_t height, std::int64_t width, torch::ScalarType type) {
  torch::manual_seed(11);
  const auto f64 = torch::dtype(torch::kFloat64);
  const Tensor y = torch::linspace(0.0, 6.0, height, f64).reshape({height, 1, 1});
  const Tensor x = torch::linspace(0.0, 9.0, width, f64).reshape({1, width, 1});
  const Tensor phase = torch::tensor({0.0, 1.0, 2.5}, f64);
  const Tensor target = 0.5 + 0.3 * torch::sin(x + phase) * torch::cos(y - phase) +
                        0.1 * torch::rand({height, width, 3}, f64);
  const Tensor image = (target + 0.1 * torch::randn({height, width, 3}, f64)).clamp(0.0, 1.0);
  return {image.to(type).requires_grad_(true), target.to(type)};
}

Tensor gradient(const Tensor& loss, const Tensor& image) {
  return torch::autograd::grad({loss}, {image}).front();
}

TEST(PhotometricLoss, GradientMatchesCentralDifferences) {
  for (const double ssim_weight : {0.0, 0.2, 1.0}) {
    const Pair pair = make_pair(13, 9, torch::kFloat64);
    const auto loss = [&] { return photometric_loss(pair.image, pair.target, ssim_weight); };
    const Tensor numeric = numeric_gradient(loss, pair.image, 1e-6);
    const Tensor analytic = gradient(loss(), pair.image);
    EXPECT_TRUE(tensors_near(analytic * 100.0, numeric * 100.0, 1e-6)) << ssim_weight;
  }
}

TEST(PhotometricLoss, MatchesTwoDimensionalReferenceAndAutograd) {
  for (const auto type : {torch::kFloat64, torch::kFloat32}) {
    const Pair pair = make_pair(61, 83, type);
    const Pair exact = make_pair(61, 83, torch::kFloat64);
    const Tensor got = photometric_loss(pair.image, pair.target, 0.2);
    const Tensor expected = reference_loss(exact.image, exact.target, 0.2);
    const double tolerance = type == torch::kFloat64 ? 1e-13 : 1e-6;
    EXPECT_TRUE(tensors_near(got, expected, tolerance));
    const double values = 61 * 83 * 3;  // gradients of a mean are tiny: compare those of the sum
    EXPECT_TRUE(tensors_near(values * gradient(got, pair.image),
                             values * gradient(expected, exact.image), 100 * tolerance));
  }
}

TEST(PhotometricLoss, IgnoresMaskedPixels) {
  const Pair pair = make_pair(40, 31, torch::kFloat64);
  const Tensor valid = torch::rand({40, 31}) > 0.3;
  const Tensor got = photometric_loss(pair.image, pair.target, 0.2, valid);
  const Tensor expected = reference_loss(pair.image, pair.target, 0.2, valid);
  EXPECT_TRUE(tensors_near(got, expected, 1e-13));
  const Tensor by_image = gradient(got, pair.image);
  EXPECT_TRUE(tensors_near(by_image, gradient(expected, pair.image), 1e-13));
  EXPECT_EQ(by_image.index({~valid}).abs().max().item<double>(), 0.0);
  EXPECT_GT(by_image.index({valid}).abs().min().item<double>(), 0.0);
}

TEST(PhotometricLoss, IsZeroForEqualImagesAndWithoutValidPixels) {
  const Pair pair = make_pair(20, 20, torch::kFloat64);
  EXPECT_NEAR(photometric_loss(pair.target, pair.target, 0.2).item<double>(), 0.0, 1e-14);
  const Tensor none =
      photometric_loss(pair.image, pair.target, 0.2, torch::zeros({20, 20}, torch::kBool));
  EXPECT_EQ(none.item<double>(), 0.0);
  EXPECT_EQ(gradient(none, pair.image).abs().max().item<double>(), 0.0);
}

TEST(PhotometricLoss, SupportsImagesSmallerThanTheWindow) {
  for (const auto& [height, width] : {std::pair{1, 1}, {1, 30}, {30, 1}, {4, 5}}) {
    const Pair pair = make_pair(height, width, torch::kFloat64);
    const Tensor got = photometric_loss(pair.image, pair.target, 0.2);
    const Tensor expected = reference_loss(pair.image, pair.target, 0.2);
    EXPECT_TRUE(tensors_near(got, expected, 1e-13)) << height << " x " << width;
    EXPECT_TRUE(tensors_near(gradient(got, pair.image), gradient(expected, pair.image), 1e-12));
  }
}

TEST(ParallelLoops, UseLibTorchThreadCount) {
  const int threads = at::get_num_threads();
  at::set_num_threads(3);
  std::array<int, 3> seen = {};
  at::parallel_for(0, 3, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) {
      seen[static_cast<std::size_t>(i)] = at::get_thread_num();
    }
  });
  at::set_num_threads(threads);
  EXPECT_EQ(seen, (std::array<int, 3>{0, 1, 2}));
}

TEST(PhotometricLoss, IsIndependentOfThreadCount) {
  const Pair pair = make_pair(201, 90, torch::kFloat32);
  const int threads = at::get_num_threads();
  at::set_num_threads(1);
  const Tensor loss = photometric_loss(pair.image, pair.target, 0.2);
  const Tensor alone = gradient(loss, pair.image);
  for (const int n : {2, 3, 5}) {
    at::set_num_threads(n);
    const Tensor again = photometric_loss(pair.image, pair.target, 0.2);
    EXPECT_TRUE(torch::equal(again, loss)) << n;
    EXPECT_TRUE(torch::equal(gradient(again, pair.image), alone)) << n;
  }
  at::set_num_threads(threads);
}

TEST(PhotometricLoss, GradientScalesWithUpstreamGradient) {
  const Pair pair = make_pair(24, 18, torch::kFloat64);
  const Tensor once = gradient(photometric_loss(pair.image, pair.target, 0.2), pair.image);
  const Tensor thrice = gradient(3.0 * photometric_loss(pair.image, pair.target, 0.2), pair.image);
  EXPECT_TRUE(tensors_near(thrice, 3.0 * once, 1e-15));
}

TEST(PhotometricLoss, SupportsNonContiguousImages) {
  const Pair pair = make_pair(24, 18, torch::kFloat64);
  const Tensor planes = pair.image.detach().permute({2, 0, 1}).contiguous();
  const Tensor got = photometric_loss(planes.permute({1, 2, 0}), pair.target, 0.2);
  EXPECT_TRUE(tensors_near(got, reference_loss(pair.image, pair.target, 0.2), 1e-13));
}

TEST(PhotometricLoss, RejectsInvalidArguments) {
  const Pair pair = make_pair(12, 14, torch::kFloat32);
  EXPECT_THROW(photometric_loss(pair.image, pair.target.transpose(0, 1), 0.2), c10::Error);
  EXPECT_THROW(photometric_loss(pair.image, pair.target.to(torch::kFloat64), 0.2), c10::Error);
  EXPECT_THROW(photometric_loss(pair.image, pair.target, 1.5), c10::Error);
  EXPECT_THROW(photometric_loss(pair.image, pair.target, 0.2, torch::ones({14, 12})), c10::Error);
  EXPECT_THROW(photometric_loss(torch::rand({0, 4, 3}), torch::rand({0, 4, 3}), 0.2), c10::Error);
}

}  // namespace
}  // namespace apvi::gaussians
