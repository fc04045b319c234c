// SPDX-License-Identifier: BSD-3-Clause
#include "survey/terrain_statistics.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "apvi/core/constants.hpp"

namespace apvi::survey {
namespace {

using torch::Tensor;

/// Areas of triangles with two edges of `side` along x and y and these height differences.
Tensor triangle_areas(const Tensor& along_x, const Tensor& along_y, double side) {
  return 0.5 * side * (side * side + along_x.square() + along_y.square()).sqrt();
}

}  // namespace

void TerrainStatistics::add(const Tensor& elevation) {
  const torch::NoGradGuard no_grad;
  const Tensor z = elevation.to(torch::kFloat64);
  if (z.size(0) < 2 || z.size(1) < 2) return;
  const auto part = [&z](std::int64_t row, std::int64_t column) {
    return z.narrow(0, row, z.size(0) - 1).narrow(1, column, z.size(1) - 1);
  };
  const Tensor known = ~(part(0, 0) + part(0, 1) + part(1, 0) + part(1, 1)).isnan();
  const Tensor a = part(0, 0).index({known});
  const Tensor b = part(0, 1).index({known});
  const Tensor c = part(1, 0).index({known});
  const Tensor d = part(1, 1).index({known});
  if (a.numel() == 0) return;
  const auto sum = [](const Tensor& t) { return t.sum().item<double>(); };
  cells_ += a.numel();
  surface_area_m2_ += sum(triangle_areas(b - a, c - a, resolution_m_) +
                          triangle_areas(d - c, d - b, resolution_m_));
  const Tensor by_x = (b + d - a - c) / (2.0 * resolution_m_);
  const Tensor by_y = (c + d - a - b) / (2.0 * resolution_m_);
  slope_sum_deg_ += sum(torch::hypot(by_x, by_y).atan()) * kDegreesPerRadian;
  height_sum_m_ += sum(0.25 * (a + b + c + d));
  const Tensor corners = torch::stack({a, b, c, d});
  lowest_m_ = std::min(lowest_m_, corners.min().item<double>());
  highest_m_ = std::max(highest_m_, corners.max().item<double>());
}

double TerrainStatistics::planar_area_m2() const {
  return static_cast<double>(cells_) * resolution_m_ * resolution_m_;
}

double TerrainStatistics::volume_above_lowest_m3() const {
  if (cells_ == 0) return 0.0;
  return resolution_m_ * resolution_m_ * (height_sum_m_ - lowest_m_ * static_cast<double>(cells_));
}

}  // namespace apvi::survey
