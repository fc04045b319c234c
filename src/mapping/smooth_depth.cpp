// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/smooth_depth.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "apvi/mapping/step_backend.hpp"

namespace apvi::mapping {
namespace {

constexpr std::int64_t kLeastSide = 80;  // [px] in less, a second difference is no small part

}  // namespace

torch::Tensor bentness(const torch::Tensor& depth, const torch::Tensor& alpha,
                       const torch::Tensor& picture) {
  if (std::min(depth.size(0), depth.size(1)) < kLeastSide) return depth.new_zeros({});
  return step_backend(depth.device()).bentness(depth, alpha, picture);
}

}  // namespace apvi::mapping
