// SPDX-License-Identifier: BSD-3-Clause
#include "blur.hpp"

#include <torch/torch.h>

#include <cmath>

namespace apvi::mapping {

using torch::Tensor;

Tensor blurred(const Tensor& planes, double sigma) {
  const auto radius = static_cast<std::int64_t>(std::ceil(3.0 * sigma));
  const Tensor x = torch::arange(-radius, radius + 1, planes.options());
  const Tensor taps = torch::exp(-x.square() / (2.0 * sigma * sigma));
  const Tensor weights = taps / taps.sum();
  const Tensor padded = torch::replication_pad2d(planes, {radius, radius, radius, radius});
  return torch::conv2d(torch::conv2d(padded, weights.view({1, 1, 1, -1})),
                       weights.view({1, 1, -1, 1}));
}

}  // namespace apvi::mapping
