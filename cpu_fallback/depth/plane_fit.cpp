// SPDX-License-Identifier: BSD-3-Clause
#include <ATen/Parallel.h>
#include <torch/torch.h>

#include <cmath>

#include "cpu_fallback/depth/depth_sweep.hpp"
#include "depth/plane_fit.hpp"

namespace apvi::depth::cpu {
namespace {

constexpr std::int64_t kBlocksPerTask = 1024;

void fit(const PlaneFitInput& in, std::int64_t i, FittedPlanes& out) {
  const auto* const value = in.inverse_depths.data_ptr<float>();
  const auto* const point = in.points.data_ptr<float>();
  const auto* const neighbors = in.neighbors.data_ptr<std::int32_t>();
  const auto begin = in.offsets.data_ptr<std::int32_t>()[i];
  const auto end = in.offsets.data_ptr<std::int32_t>()[i + 1];
  PlaneFit surface;
  for (auto e = begin; e < end; ++e) {
    const std::int64_t j = neighbors[e];
    const double dw = static_cast<double>(value[j] / value[i]) - 1.0;
    if (std::abs(dw) > in.max_relative_difference) continue;
    surface.add(static_cast<double>(point[2 * j] - point[2 * i]),
                static_cast<double>(point[2 * j + 1] - point[2 * i + 1]), dw);
  }
  auto* const slope = out.slope.data_ptr<float>() + 2 * i;
  slope[0] = surface.slope_x(in.max_slope);
  slope[1] = surface.slope_y(in.max_slope);
  out.agreement.data_ptr<float>()[i] = surface.agreement(end - begin);
}

}  // namespace

FittedPlanes fit_planes(const PlaneFitInput& input) {
  FittedPlanes out = {.agreement = torch::empty_like(input.inverse_depths),
                      .slope = torch::empty_like(input.points)};
  at::parallel_for(0, input.inverse_depths.size(0), kBlocksPerTask,
                   [&](std::int64_t begin, std::int64_t end) {
                     for (std::int64_t i = begin; i < end; ++i) fit(input, i, out);
                   });
  return out;
}

}  // namespace apvi::depth::cpu
