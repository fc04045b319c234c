// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/metrics/metrics.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <limits>

namespace apvi::gaussians {
namespace {

using torch::Tensor;

struct Pair {
  Tensor image, truth;
};

enum class Distortion { paler, noisy, shifted };

/// Images with reference results of independent implementations, listed below.
Pair known_pair(std::int64_t height, std::int64_t width, Distortion distortion) {
  const auto f64 = torch::dtype(torch::kFloat64);
  const Tensor y = torch::arange(height, f64).reshape({height, 1, 1});
  const Tensor x = torch::arange(width, f64).reshape({1, width, 1});
  const Tensor c = torch::arange(3, f64);
  const Tensor slow = torch::sin(0.11 * x + c) * torch::cos(0.07 * y - 0.5 * c);
  const Tensor truth = 0.5 + 0.25 * slow + 0.15 * torch::sin(0.9 * x + 0.7 * y + c);
  if (distortion == Distortion::paler) return {0.9 * truth + 0.03, truth};
  if (distortion == Distortion::noisy) {
    return {truth + 0.1 * torch::sin(12.9898 * x + 78.233 * y + 37.719 * c), truth};
  }
  const Tensor shifted = torch::sin(0.11 * (x - 1.5) + c) * torch::cos(0.07 * y - 0.5 * c);
  return {0.5 + 0.25 * shifted + 0.10 * torch::sin(0.9 * x + 0.7 * y + c + 0.3), truth};
}

struct Known {
  std::int64_t height, width;
  Distortion distortion;
  double ssim, psnr_db;
};
// scikit-image 0.26: structural_similarity(gaussian_weights=True, sigma=1.5,
// use_sample_covariance=False, data_range=1, channel_axis=2) and peak_signal_noise_ratio.
constexpr Known kKnown[] = {
    {48, 64, Distortion::paler, 0.993891076, 31.584425},
    {48, 64, Distortion::noisy, 0.822576289, 23.018719},
    {48, 64, Distortion::shifted, 0.891468060, 26.278346},
    {11, 30, Distortion::paler, 0.993572286, 30.079778},
    {11, 30, Distortion::noisy, 0.815278973, 23.013587},
    {11, 30, Distortion::shifted, 0.888734670, 25.819544},
    {181, 190, Distortion::shifted, 0.891456533, 26.298603},
};

TEST(ImageMetrics, SsimMatchesScikitImage) {
  for (const Known& known : kKnown) {
    const Pair pair = known_pair(known.height, known.width, known.distortion);
    EXPECT_NEAR(ssim(pair.image, pair.truth).value(), known.ssim, 1e-8);
    const Pair bytes = {pair.image.to(torch::kFloat32), pair.truth.to(torch::kFloat32)};
    EXPECT_NEAR(ssim(bytes.image, bytes.truth).value(), known.ssim, 1e-6);
  }
}

TEST(ImageMetrics, PsnrMatchesScikitImage) {
  for (const Known& known : kKnown) {
    const Pair pair = known_pair(known.height, known.width, known.distortion);
    EXPECT_NEAR(psnr(pair.image, pair.truth), known.psnr_db, 1e-6);
  }
}

TEST(ImageMetrics, MultiScaleSsimMatchesIndependentImplementation) {
  const std::pair<Distortion, double> known[] = {{Distortion::paler, 0.994626291},
                                                 {Distortion::noisy, 0.988236407},
                                                 {Distortion::shifted, 0.955367741}};
  for (const auto& [distortion, expected] : known) {
    const Pair pair = known_pair(181, 190, distortion);
    EXPECT_NEAR(ms_ssim(pair.image, pair.truth).value(), expected, 1e-8);
  }
}

TEST(ImageMetrics, EqualImagesHaveBestScores) {
  const Tensor truth = known_pair(181, 190, Distortion::noisy).truth;
  EXPECT_EQ(psnr(truth, truth), std::numeric_limits<double>::infinity());
  EXPECT_NEAR(ssim(truth, truth).value(), 1.0, 1e-12);
  EXPECT_NEAR(ms_ssim(truth, truth).value(), 1.0, 1e-12);
}

TEST(ImageMetrics, AreAbsentForTooSmallImages) {
  const Tensor small = torch::rand({10, 40, 3});
  EXPECT_FALSE(ssim(small, small).has_value());
  EXPECT_FALSE(ms_ssim(torch::rand({175, 300, 3}), torch::rand({175, 300, 3})).has_value());
  EXPECT_TRUE(ms_ssim(torch::rand({176, 176, 3}), torch::rand({176, 176, 3})).has_value());
}

TEST(ImageMetrics, RejectMismatchedImages) {
  EXPECT_THROW(psnr(torch::rand({4, 5, 3}), torch::rand({5, 4, 3})), c10::Error);
  EXPECT_THROW(ssim(torch::rand({20, 20}), torch::rand({20, 20})), c10::Error);
}

TEST(MedianImage, IsPerPixelMedian) {
  torch::manual_seed(1);
  std::vector<Tensor> images;
  for (int i = 0; i < 7; ++i) images.push_back(torch::rand({9, 8, 3}));
  const Tensor sorted = std::get<0>(torch::stack(images).sort(0));
  EXPECT_TRUE(torch::equal(median_image(images), sorted[3]));
  EXPECT_TRUE(torch::equal(median_image({images[0]}), images[0]));
}

TEST(MedianImage, SupportsMoreImagesThanFitIntoOneBand) {
  torch::manual_seed(2);
  const Tensor image = (torch::rand({700, 500, 3}) * 255).to(torch::kUInt8);
  std::vector<Tensor> images(101, image);
  images[0] = torch::zeros_like(image);
  images[1] = torch::full_like(image, 255);
  EXPECT_TRUE(torch::equal(median_image(images), image));
}

TEST(MedianImage, RejectsImagesOfDifferentSizes) {
  EXPECT_THROW(median_image({}), c10::Error);
  EXPECT_THROW(median_image({torch::rand({4, 5, 3}), torch::rand({5, 4, 3})}), c10::Error);
}

TEST(DepthErrors, UsePixelsValidInBothMaps) {
  const Tensor truth = torch::tensor({{2.0, 4.0, 0.0}, {5.0, 10.0, 1.0}}, torch::kFloat64);
  const Tensor depth = torch::tensor(
      {{2.2, 3.0, 7.0}, {0.0, std::numeric_limits<double>::infinity(), 1.0}}, torch::kFloat64);
  const DepthErrors errors = depth_errors(depth, truth).value();
  EXPECT_EQ(errors.pixels, 3);
  EXPECT_NEAR(errors.rmse_m, std::sqrt((0.04 + 1.0) / 3.0), 1e-12);
  EXPECT_NEAR(errors.abs_rel, (0.1 + 0.25) / 3.0, 1e-12);
  EXPECT_NEAR(errors.coverage, 3.0 / 5.0, 1e-12);
}

TEST(HalfPixelDepth, IsHalfTheDifferenceOfNeighbors) {
  const Tensor steps = torch::tensor({{1.0, 3.0, 0.0}, {1.0, 7.0, 4.0}});
  // Vertical pairs: 1 1 and 3 7; horizontal pairs: 1 3, 1 7 and 7 4.
  const double expected = std::sqrt((0.0 + 4.0 + 1.0 + 9.0 + 2.25) / 5.0);
  EXPECT_NEAR(half_pixel_depth_rmse(steps).value(), expected, 1e-12);
}

TEST(HalfPixelDepth, IsAbsentWithoutNeighboringDepths) {
  EXPECT_FALSE(half_pixel_depth_rmse(torch::tensor({{1.0, 0.0}, {0.0, 2.0}})).has_value());
  EXPECT_DOUBLE_EQ(half_pixel_depth_rmse(torch::full({4, 5}, 2.0)).value(), 0.0);
}

TEST(DepthErrors, AreAbsentWithoutCommonPixels) {
  EXPECT_FALSE(depth_errors(torch::zeros({3, 3}), torch::ones({3, 3})).has_value());
  EXPECT_THROW(depth_errors(torch::zeros({3, 3}), torch::ones({3, 4})), c10::Error);
}

TEST(Metrics, PixelsThatAreNotValidDoNotCount) {
  const Pair pair = known_pair(48, 64, Distortion::noisy);
  const Tensor valid = torch::ones({48, 64}, torch::kBool);
  valid.slice(1, 40).fill_(false);
  const Tensor overlay = pair.image.clone();
  overlay.slice(1, 40).fill_(1.0);
  const auto left = [](const Tensor& t) { return t.slice(1, 0, 40); };
  EXPECT_NEAR(psnr(overlay, pair.truth, valid), psnr(left(pair.image), left(pair.truth)), 1e-9);
  // Windows that reach beyond the boundary see the overlay; their centers are on this side.
  const Tensor far = valid.clone();
  far.slice(1, 35).fill_(false);
  EXPECT_NEAR(*ssim(overlay, pair.truth, far), *ssim(left(pair.image), left(pair.truth)), 1e-9);
}

}  // namespace
}  // namespace apvi::gaussians
