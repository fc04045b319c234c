// SPDX-License-Identifier: BSD-3-Clause
#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "depth_sweep.hpp"

namespace apvi::mapping::cpu {
namespace {

constexpr std::int64_t kBlocksPerTask = 1024;

void fit(const SurfaceInput& in, std::int64_t i, Surfaces& out) {
  const auto* const value = in.inverse_depths.data_ptr<float>();
  const auto* const point = in.points.data_ptr<float>();
  const auto* const neighbors = in.neighbors.data_ptr<std::int32_t>();
  const auto begin = in.offsets.data_ptr<std::int32_t>()[i];
  const auto end = in.offsets.data_ptr<std::int32_t>()[i + 1];
  double xx = 1.0, xy = 0.0, yy = 1.0, xw = 0.0, yw = 0.0;
  int alike = 0;
  for (auto e = begin; e < end; ++e) {
    const std::int64_t j = neighbors[e];
    const double dw = static_cast<double>(value[j] / value[i]) - 1.0;
    if (std::abs(dw) > in.same) continue;
    ++alike;
    const double dx = static_cast<double>(point[2 * j] - point[2 * i]);
    const double dy = static_cast<double>(point[2 * j + 1] - point[2 * i + 1]);
    xx += dx * dx;
    xy += dx * dy;
    yy += dy * dy;
    xw += dx * dw;
    yw += dy * dw;
  }
  const double determinant = xx * yy - xy * xy;
  const auto within = [&](double x) {
    return static_cast<float>(std::clamp(x, -in.steepest, in.steepest));
  };
  auto* const slope = out.slope.data_ptr<float>() + 2 * i;
  slope[0] = within((yy * xw - xy * yw) / determinant);
  slope[1] = within((xx * yw - xy * xw) / determinant);
  out.agreement.data_ptr<float>()[i] =
      end > begin ? static_cast<float>(alike) / static_cast<float>(end - begin) : 1.0F;
}

}  // namespace

Surfaces surfaces(const SurfaceInput& input) {
  Surfaces out = {.agreement = torch::empty_like(input.inverse_depths),
                  .slope = torch::empty_like(input.points)};
  at::parallel_for(0, input.inverse_depths.size(0), kBlocksPerTask,
                   [&](std::int64_t begin, std::int64_t end) {
                     for (std::int64_t i = begin; i < end; ++i) fit(input, i, out);
                   });
  return out;
}

}  // namespace apvi::mapping::cpu
