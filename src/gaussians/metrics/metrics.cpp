// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/metrics/metrics.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace apvi::gaussians {
namespace {

using torch::Tensor;

constexpr std::int64_t kWindow = 11;
constexpr double kSigma = 1.5;
constexpr double kC1 = 0.01 * 0.01;
constexpr double kC2 = 0.03 * 0.03;
constexpr std::array<double, 5> kScaleWeights = {0.0448, 0.2856, 0.3001, 0.2363, 0.1333};
constexpr std::int64_t kMedianBytes = 64 << 20;  // per band of rows

void check_images(const Tensor& image, const Tensor& truth) {
  TORCH_CHECK(image.dim() == 3 && image.size(2) == 3 && image.numel() > 0,
              "metric: the image must be [H,W,3] and not empty, not ", image.sizes());
  TORCH_CHECK(image.sizes() == truth.sizes(), "metric: the images have shapes ", image.sizes(),
              " and ", truth.sizes());
}

/// [3,1,H,W] float64: in float the variances of bright, smooth images are lost to rounding.
Tensor planes(const Tensor& image) {
  return image.detach().to(torch::kFloat64).permute({2, 0, 1}).unsqueeze(1);
}

/// Gaussian-weighted mean over every valid window.
Tensor blur(const Tensor& x) {
  const Tensor offsets = torch::arange(kWindow, x.options()) - (kWindow - 1) / 2;
  const Tensor taps = torch::exp(-offsets.square() / (2.0 * kSigma * kSigma));
  const Tensor weights = taps / taps.sum();
  return torch::conv2d(torch::conv2d(x, weights.view({1, 1, 1, kWindow})),
                       weights.view({1, 1, kWindow, 1}));
}

struct Similarity {
  double structural;  ///< mean of luminance times contrast-structure
  double contrast;    ///< mean of contrast-structure
};

/// `valid` [H,W] bool, of the centers of windows, or undefined.
Similarity similarity(const Tensor& x, const Tensor& y, const Tensor& valid = {}) {
  const Tensor mean_x = blur(x);
  const Tensor mean_y = blur(y);
  const Tensor variances = blur(x * x + y * y) - mean_x * mean_x - mean_y * mean_y;
  const Tensor covariance = blur(x * y) - mean_x * mean_y;
  const Tensor luminance =
      (2.0 * mean_x * mean_y + kC1) / (mean_x * mean_x + mean_y * mean_y + kC1);
  const Tensor contrast = (2.0 * covariance + kC2) / (variances + kC2);
  const auto mean = [&valid](const Tensor& values) {
    if (!valid.defined()) return values.mean().item<double>();
    const Tensor inner = valid.slice(0, kWindow / 2, valid.size(0) - kWindow / 2)
                             .slice(1, kWindow / 2, valid.size(1) - kWindow / 2);
    return values.masked_select(inner).mean().item<double>();
  };
  return {mean(luminance * contrast), mean(contrast)};
}

Tensor halved(const Tensor& x) {
  return torch::avg_pool2d(x, 2);
}

Tensor is_valid(const Tensor& depth) {
  return (depth > 0) & torch::isfinite(depth);
}

}  // namespace

double psnr(const Tensor& image, const Tensor& truth, const Tensor& valid) {
  check_images(image, truth);
  Tensor difference = image.detach().to(torch::kFloat64) - truth.detach().to(torch::kFloat64);
  if (valid.defined()) difference = difference.masked_select(valid.unsqueeze(2));
  return -10.0 * std::log10(difference.square().mean().item<double>());
}

std::optional<double> ssim(const Tensor& image, const Tensor& truth, const Tensor& valid) {
  check_images(image, truth);
  if (std::min(image.size(0), image.size(1)) < kWindow) return std::nullopt;
  return similarity(planes(image), planes(truth), valid).structural;
}

std::optional<double> ms_ssim(const Tensor& image, const Tensor& truth) {
  check_images(image, truth);
  const auto halvings = static_cast<std::int64_t>(kScaleWeights.size()) - 1;
  if (std::min(image.size(0), image.size(1)) >> halvings < kWindow) return std::nullopt;
  Tensor x = planes(image);
  Tensor y = planes(truth);
  double product = 1.0;
  for (std::size_t scale = 0; scale < kScaleWeights.size(); ++scale) {
    const bool is_last = scale + 1 == kScaleWeights.size();
    const Similarity s = similarity(x, y);
    const double factor = std::max(is_last ? s.structural : s.contrast, 0.0);
    product *= std::pow(factor, kScaleWeights.at(scale));
    x = halved(x);
    y = halved(y);
  }
  return product;
}

Tensor median_image(const std::vector<Tensor>& images) {
  TORCH_CHECK(!images.empty(), "metric: the median of zero images is undefined");
  for (const Tensor& image : images) {
    TORCH_CHECK(image.sizes() == images.front().sizes() && image.dim() == 3,
                "metric: the images must have the same size, not ", image.sizes(), " and ",
                images.front().sizes());
  }
  Tensor median = torch::empty_like(images.front());
  const std::int64_t row_bytes =
      static_cast<std::int64_t>(images.size() * images.front()[0].nbytes());
  const std::int64_t band =
      std::max<std::int64_t>(1, kMedianBytes / std::max<std::int64_t>(row_bytes, 1));
  for (std::int64_t y = 0; y < median.size(0); y += band) {
    const std::int64_t rows = std::min(band, median.size(0) - y);
    std::vector<Tensor> bands;
    for (const Tensor& image : images) bands.push_back(image.detach().narrow(0, y, rows));
    median.narrow(0, y, rows).copy_(std::get<0>(torch::stack(bands).median(0)));
  }
  return median;
}

std::optional<DepthErrors> depth_errors(const Tensor& depth, const Tensor& truth) {
  TORCH_CHECK(depth.dim() == 2 && depth.sizes() == truth.sizes(), "metric: depth maps ",
              depth.sizes(), " and ", truth.sizes(), " do not match");
  const Tensor has_truth = is_valid(truth);
  const Tensor both = has_truth & is_valid(depth);
  const auto pixels = both.sum().item<std::int64_t>();
  if (pixels == 0) return std::nullopt;
  const Tensor expected = truth.detach().index({both}).to(torch::kFloat64);
  const Tensor error = depth.detach().index({both}).to(torch::kFloat64) - expected;
  return DepthErrors{.rmse_m = std::sqrt(error.square().mean().item<double>()),
                     .abs_rel = (error.abs() / expected).mean().item<double>(),
                     .coverage = static_cast<double>(pixels) / has_truth.sum().item<double>(),
                     .pixels = pixels};
}

std::optional<double> half_pixel_depth_rmse(const Tensor& truth) {
  TORCH_CHECK(truth.dim() == 2, "metric: a depth map must be [H,W], not ", truth.sizes());
  const Tensor depth = truth.detach().to(torch::kFloat64);
  double squares = 0.0;
  std::int64_t pairs = 0;
  for (const std::int64_t dim : {0, 1}) {
    const Tensor current = depth.slice(dim, 0, -1);
    const Tensor next = depth.slice(dim, 1);
    const Tensor both = is_valid(current) & is_valid(next);
    // The value half way between two pixels is their mean, half the difference away from each.
    squares += (0.5 * (next - current)).index({both}).square().sum().item<double>();
    pairs += both.sum().item<std::int64_t>();
  }
  if (pairs == 0) return std::nullopt;
  return std::sqrt(squares / static_cast<double>(pairs));
}

}  // namespace apvi::gaussians
