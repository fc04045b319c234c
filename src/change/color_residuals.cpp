// SPDX-License-Identifier: BSD-3-Clause
#include "change/color_residuals.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "change/neighborhoods.hpp"
#include "change/surface_cells.hpp"

namespace apvi::change {
namespace {

using torch::Tensor;

constexpr double kMad = 1.4826;
constexpr double kBlock_m = 1.0;
constexpr double kUnchanged = 0.9;          // part of a neighborhood, at least
constexpr double kUnchangedSigmas = 1.645;  // that many deviations of a normal law contain it
constexpr double kMinNoise = 0.01;          // of a logarithm
constexpr double kFloor = 1e-2;             // variance in units of the noise
constexpr double kMinSlope = 0.5;
constexpr int kCovariances = 10;
constexpr double kTrim = 9.0;        // squared Mahalanobis distance
constexpr double kTrimmed = 0.9155;  // variance of a normal law in 3D cut off there

Tensor medians(const Tensor& values) {
  return std::get<0>(values.median(0));
}

Tensor deviations(const Tensor& values) {
  return (kMad * medians((values - medians(values)).abs())).clamp_min(kMinNoise);
}

Tensor squared_distances(const Tensor& residual, const Tensor& covariance) {
  return (residual.mm(torch::linalg_inv(covariance)) * residual).sum(1);
}

/// Squared Mahalanobis distances of residuals in units of their noise, by the correlation of those
/// that are not outliers.
Tensor normalized(const Tensor& residual) {
  const Tensor floor = kFloor * torch::eye(3, residual.options());
  Tensor covariance = torch::diag(deviations(residual).square());
  for (int i = 0; i < kCovariances; ++i) {
    const Tensor inner = (squared_distances(residual, covariance) < kTrim).nonzero().squeeze(1);
    if (inner.numel() < 4) break;
    const Tensor kept = residual.index_select(0, inner);
    covariance = kept.t().mm(kept) / static_cast<double>(inner.numel()) / kTrimmed + floor;
  }
  const Tensor scale = covariance.diag().sqrt();
  return squared_distances(residual, covariance / torch::outer(scale, scale));
}

}  // namespace

ColorResiduals color_residuals(const ColorPairs& pairs, double cell_m, double radius_m) {
  const torch::NoGradGuard no_grad;
  const Tensor slope =
      (deviations(pairs.after) / deviations(pairs.before)).clamp(kMinSlope, 1.0 / kMinSlope);
  const Tensor offset = medians(pairs.after - slope * pairs.before);
  const Tensor line = pairs.after - slope * pairs.before - offset;
  const Neighborhoods neighborhoods(pairs.points, kBlock_m);
  const Tensor flat = line - neighborhoods.quantiles(line, 0.5);
  const auto reach = std::max<std::int64_t>(1, std::lround(radius_m / cell_m));
  const Tensor residual = averaged_over_cells(pairs.keys, flat, reach);
  const Tensor around = neighborhoods.quantiles(residual.abs(), kUnchanged) / kUnchangedSigmas;
  const Tensor noise =
      torch::maximum(around, deviations_by_support(residual, pairs.support)).clamp_min(kMinNoise);
  return {residual, normalized(residual / noise).sqrt(), slope, offset};
}

}  // namespace apvi::change
