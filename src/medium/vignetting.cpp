// SPDX-License-Identifier: BSD-3-Clause
#include "medium/vignetting.hpp"

#include <torch/torch.h>

#include <algorithm>

namespace apvi::medium {
namespace {

constexpr double kMaxLogLoss = 3.0;  // a factor of 0.05 in the corners

}  // namespace

torch::Tensor Vignetting::factor(const torch::Tensor& corners2) const {
  return torch::exp(-corners2 * (square + fourth * corners2));
}

Vignetting Vignetting::confined() const {
  const double a = std::clamp(square, 0.0, kMaxLogLoss);
  return {.square = a, .fourth = std::clamp(fourth, -0.5 * a, kMaxLogLoss - a)};
}

}  // namespace apvi::medium
