// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/smooth_depth.hpp"

#include <torch/torch.h>

#include <algorithm>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kReach = 6;       // [px] of a second difference, to each side
constexpr std::int64_t kLeastSide = 80;  // [px] in less, that is no small part of a picture
constexpr double kSolid = 0.5;           // alpha of a surface
constexpr double kEdge = 0.05;  // second difference of a grey level (0 to 1) that is an edge
constexpr double kGap = 0.02;   // the same of what is solid: what ends there is not bent

/// Second differences [...,2,H-2r,W-2r] of [...,H,W], down and across, r = kReach. By slices: a
/// convolution with so few taps so far apart is slow.
Tensor second_differences(const Tensor& image) {
  const auto part = [&image](std::int64_t down, std::int64_t across) {
    return image.narrow(-2, down, image.size(-2) - 2 * kReach)
        .narrow(-1, across, image.size(-1) - 2 * kReach);
  };
  const Tensor twice = 2.0 * part(kReach, kReach);
  return torch::stack({part(0, kReach) + part(2 * kReach, kReach) - twice,
                       part(kReach, 0) + part(kReach, 2 * kReach) - twice},
                      -3);
}

}  // namespace

Tensor bentness(const Tensor& depth, const Tensor& alpha, const Tensor& picture) {
  if (std::min(depth.size(0), depth.size(1)) < kLeastSide) return depth.new_zeros({});
  Tensor solid, even, scale;
  {
    const torch::NoGradGuard no_grad;
    solid = ((alpha > kSolid) & (depth > 0.0)).to(depth.scalar_type());
    scale = solid.sum() / (solid / depth.clamp_min(1e-3)).sum().clamp_min(1e-6);
    const Tensor change = second_differences(torch::stack({picture.mean(2), solid})).abs();
    even = torch::exp(change[0] / -kEdge - change[1] / kGap);
  }
  const Tensor inverse = solid / depth.clamp_min(1e-3);
  return scale * (even * second_differences(inverse).abs()).mean();
}

}  // namespace apvi::mapping
