// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/depth_curvature_loss.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "mapping/training/step_backend.hpp"

namespace apvi::mapping {
namespace {

constexpr std::int64_t kMinSide = 80;  // [px] second differences are inaccurate in smaller images

}  // namespace

torch::Tensor depth_curvature_loss(const torch::Tensor& depth, const torch::Tensor& alpha,
                                   const torch::Tensor& image) {
  if (std::min(depth.size(0), depth.size(1)) < kMinSide) return depth.new_zeros({});
  return step_backend(depth.device()).depth_curvature_loss(depth, alpha, image);
}

}  // namespace apvi::mapping
