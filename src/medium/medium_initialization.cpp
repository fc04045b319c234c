// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium_initialization.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

namespace apvi::medium {
namespace {

using torch::Tensor;

constexpr std::int64_t kMaxPixels = 400000;
constexpr std::int64_t kBins = 32;
constexpr std::int64_t kMinBinSize = 50;
constexpr std::int64_t kDarkPixelDivisor = 20;  // one in this many pixels counts as dark
constexpr double kMinContrast = 0.01;           // below, noise and quantization dominate
constexpr double kMinEmptyFraction = 0.002;     // of the pixels
constexpr double kMaxOpenWaterIqr = 0.05;       // interquartile range of a channel in open water
constexpr double kModelError = 0.01;            // surface colors are not independent of range
constexpr double kLogRatioSigma = 0.2;          // of log(beta_b / beta_d) between waters
constexpr double kMinBeta = 1e-3;               // [1/m]
constexpr double kMaxBeta = 5.0;

/// Pixels [P,3] with range [P], and pixels [E,3] without.
struct Pixels {
  Tensor color;
  Tensor range;
  Tensor empty;
};

Tensor every_nth(const Tensor& t, std::int64_t max_count) {
  return t.slice(0, 0, t.size(0), 1 + t.size(0) / max_count);
}

Pixels gather(const std::vector<Tensor>& colors, const std::vector<Tensor>& ranges) {
  TORCH_CHECK(!colors.empty() && colors.size() == ranges.size(), "medium: ", colors.size(),
              " images, but ", ranges.size(), " with ranges");
  std::vector<Tensor> flat_colors;
  std::vector<Tensor> flat_ranges;
  const std::int64_t max_count = kMaxPixels / static_cast<std::int64_t>(colors.size()) + 1;
  for (std::size_t i = 0; i < colors.size(); ++i) {
    const Tensor& color = colors[i];
    TORCH_CHECK(color.dim() == 3 && color.size(2) == 3 && ranges[i].dim() == 2 &&
                    ranges[i].size(0) == color.size(0) && ranges[i].size(1) == color.size(1),
                "medium: an image ", color.sizes(), " with ranges ", ranges[i].sizes());
    flat_colors.push_back(every_nth(color.detach().reshape({-1, 3}), max_count));
    flat_ranges.push_back(every_nth(ranges[i].detach().reshape({-1}), max_count));
  }
  const Tensor color = torch::cat(flat_colors).to(torch::kCPU, torch::kFloat64);
  const Tensor range = torch::cat(flat_ranges).to(torch::kCPU, torch::kFloat64);
  const Tensor known = (range > 0.0) & torch::isfinite(range);
  return {color.index({known}), range.index({known}), color.index({~known})};
}

/// Statistics of one channel in a range bin.
struct Bin {
  double range;
  double dark;      ///< low quantile of the color
  double contrast;  ///< standard deviation
};
using Bins = std::vector<Bin>;

/// Bins of equal pixel count, by channel.
std::array<Bins, 3> bins_of(const Pixels& pixels) {
  std::array<Bins, 3> bins;
  const std::int64_t count = pixels.range.size(0);
  const Tensor order = torch::argsort(pixels.range);
  const std::int64_t size = std::max(count / kBins, kMinBinSize);
  for (std::int64_t begin = 0; begin + size <= count; begin += size) {
    const Tensor rows = order.narrow(0, begin, size);
    const double range = pixels.range.index_select(0, rows).mean().item<double>();
    const Tensor color = pixels.color.index_select(0, rows);
    const Tensor dark = std::get<0>(color.kthvalue(1 + size / kDarkPixelDivisor, 0));
    const Tensor contrast = color.std(0, false);
    for (std::size_t c = 0; c < 3; ++c) {
      const auto channel = static_cast<std::int64_t>(c);
      bins[c].push_back({range, dark[channel].item<double>(), contrast[channel].item<double>()});
    }
  }
  return bins;
}

/// The color of open water, if visible.
std::optional<std::array<double, 3>> open_water(const Pixels& pixels) {
  const auto empty = static_cast<double>(pixels.empty.size(0));
  const auto all = empty + static_cast<double>(pixels.range.size(0));
  if (empty == 0.0 || empty < kMinEmptyFraction * all) return std::nullopt;
  const Tensor sorted = std::get<0>(pixels.empty.sort(0));
  const auto at = [&](double part) {
    return sorted[static_cast<std::int64_t>(part * (empty - 1.0))];
  };
  if ((at(0.75) - at(0.25)).max().item<double>() > kMaxOpenWaterIqr) return std::nullopt;
  const Tensor median = at(0.5);
  return std::array<double, 3>{median[0].item<double>(), median[1].item<double>(),
                               median[2].item<double>()};
}

/// Negative slope of the logarithm of contrast over range.
std::optional<double> contrast_decay(const Bins& bins) {
  double n = 0.0, z = 0.0, y = 0.0, zz = 0.0, zy = 0.0;
  for (const Bin& bin : bins) {
    if (bin.contrast < kMinContrast) continue;
    const double weight = bin.contrast * bin.contrast;  // log noise is inversely proportional
    const double log_contrast = std::log(bin.contrast);
    n += weight;
    z += weight * bin.range;
    y += weight * log_contrast;
    zz += weight * bin.range * bin.range;
    zy += weight * bin.range * log_contrast;
  }
  const double spread = n * zz - z * z;
  if (!(spread > 1e-6 * n * zz)) return std::nullopt;
  const double decay = -(n * zy - z * y) / spread;
  if (!(decay > kMinBeta)) return std::nullopt;
  return std::min(decay, kMaxBeta);
}

struct DarkFit {
  double b_inf;
  double cost;  ///< sum of squared residuals
};

/// Least-squares fit of the dark pixels, J exp(-beta_d z) + B (1 - exp(-beta_b z)), in J and B;
/// open water, if visible, has the weight of all bins together.
DarkFit fit_dark(const Bins& bins, double beta_d, double beta_b,
                 const std::optional<double>& open) {
  double aa = 0.0, ab = 0.0, bb = 0.0, ay = 0.0, by = 0.0, yy = 0.0;
  for (const Bin& bin : bins) {
    const double a = std::exp(-beta_d * bin.range);
    const double b = 1.0 - std::exp(-beta_b * bin.range);
    aa += a * a;
    ab += a * b;
    bb += b * b;
    ay += a * bin.dark;
    by += b * bin.dark;
    yy += bin.dark * bin.dark;
  }
  if (open) {
    const auto weight = static_cast<double>(bins.size());
    bb += weight;
    by += weight * *open;
    yy += weight * *open * *open;
  }
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const double determinant = aa * bb - ab * ab;
  if (!(determinant > 1e-9 * aa * bb)) return {0.0, kNone};
  const double J = (bb * ay - ab * by) / determinant;
  const double B = (aa * by - ab * ay) / determinant;
  if (J < 0.0 || B < 0.0 || B > 1.0) return {B, kNone};
  return {B, std::max(yy - J * ay - B * by, 0.0)};
}

struct Channel {
  double beta_d, beta_b, b_inf;
};

Channel estimate_channel(const Bins& bins, const std::optional<double>& open, Channel guess) {
  if (open) guess.b_inf = *open;
  const std::optional<double> decay = contrast_decay(bins);
  if (!decay) return guess;
  guess.beta_d = *decay;
  guess.beta_b = *decay;
  // Most probable candidate beta_b: Gaussian noise of unknown variance, and a prior of beta_b close
  // to beta_d.
  const auto count = static_cast<double>(bins.size());
  double best = std::numeric_limits<double>::infinity();
  for (double log_ratio = -2.0; log_ratio <= 2.0; log_ratio += 0.02) {
    const double beta_b = guess.beta_d * std::exp(log_ratio);
    const DarkFit fit = fit_dark(bins, guess.beta_d, beta_b, open);
    const double negative_log_posterior =
        0.5 * count * std::log(fit.cost / count + kModelError * kModelError) +
        0.5 * log_ratio * log_ratio / (kLogRatioSigma * kLogRatioSigma);
    if (negative_log_posterior < best) {
      best = negative_log_posterior;
      guess.beta_b = beta_b;
      guess.b_inf = fit.b_inf;
    }
  }
  return guess;
}

}  // namespace

Medium coastal_medium() {
  return {.beta_d = torch::tensor({0.40, 0.15, 0.12}, torch::kFloat64),
          .beta_b = torch::tensor({0.30, 0.15, 0.12}, torch::kFloat64),
          .b_inf = torch::tensor({0.10, 0.30, 0.35}, torch::kFloat64)};
}

Medium initialize_medium(const std::vector<Tensor>& colors, const std::vector<Tensor>& ranges) {
  const torch::NoGradGuard no_grad;
  const Pixels pixels = gather(colors, ranges);
  const std::array<Bins, 3> bins = bins_of(pixels);
  const auto open = open_water(pixels);
  Medium medium = coastal_medium();
  auto beta_d = medium.beta_d.accessor<double, 1>();
  auto beta_b = medium.beta_b.accessor<double, 1>();
  auto b_inf = medium.b_inf.accessor<double, 1>();
  for (std::int64_t c = 0; c < 3; ++c) {
    const auto k = static_cast<std::size_t>(c);
    const auto open_channel = open ? std::optional<double>((*open)[k]) : std::nullopt;
    const Channel channel =
        estimate_channel(bins[k], open_channel, {beta_d[c], beta_b[c], b_inf[c]});
    beta_d[c] = channel.beta_d;
    beta_b[c] = std::clamp(channel.beta_b, kMinBeta, kMaxBeta);
    b_inf[c] = std::clamp(channel.b_inf, 0.005, 0.995);
  }
  return medium;
}

}  // namespace apvi::medium
