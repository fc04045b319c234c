// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/smooth_depth.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kReach = 6;       // [px] of a second difference, to each side
constexpr std::int64_t kLeastSide = 80;  // [px] in less, that is no small part of a picture
constexpr double kSolid = 0.5;           // alpha of a surface
constexpr double kEdge = 0.05;  // second difference of a grey level (0 to 1) that is an edge
constexpr double kGap = 0.02;   // the same of what is solid: what ends there is not bent

/// Second differences [n,2,H-2r,W-2r] of planes [n,1,H,W], down and across, r = kReach.
Tensor second_differences(const Tensor& planes) {
  Tensor taps = torch::zeros({2, 1, 3, 3}, planes.options());
  for (std::int64_t along = 0; along < 2; ++along) {
    const Tensor line = along == 0 ? taps[0][0].select(1, 1) : taps[1][0].select(0, 1);
    line.copy_(torch::tensor({1.0, -2.0, 1.0}, planes.options()));
  }
  const std::array<std::int64_t, 2> stride = {1, 1};
  const std::array<std::int64_t, 2> padding = {0, 0};
  const std::array<std::int64_t, 2> dilation = {kReach, kReach};
  return torch::conv2d(planes, taps, Tensor(), at::IntArrayRef(stride), at::IntArrayRef(padding),
                       at::IntArrayRef(dilation));
}

}  // namespace

Tensor bentness(const Tensor& depth, const Tensor& alpha, const Tensor& picture) {
  if (std::min(depth.size(0), depth.size(1)) < kLeastSide) return depth.new_zeros({});
  Tensor solid, even, scale;
  {
    const torch::NoGradGuard no_grad;
    solid = ((alpha > kSolid) & (depth > 0.0)).to(depth.scalar_type());
    scale = solid.sum() / (solid / depth.clamp_min(1e-3)).sum().clamp_min(1e-6);
    const Tensor change =
        second_differences(torch::stack({picture.mean(2), solid}).unsqueeze(1)).abs();
    even = torch::exp(change[0] / -kEdge - change[1] / kGap);
  }
  const Tensor inverse = solid / depth.clamp_min(1e-3);
  const Tensor bent = second_differences(inverse.unsqueeze(0).unsqueeze(0)).squeeze(0).abs();
  return scale * (even * bent).mean();
}

}  // namespace apvi::mapping
