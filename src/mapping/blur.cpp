// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/blur.hpp"

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

Tensor blurred_inverse_depth(const Tensor& depth, double sigma) {
  const Tensor known = (depth > 0.0).to(depth.scalar_type());
  const Tensor inverse = known / depth.clamp_min(1e-6);
  const Tensor planes = blurred(torch::stack({inverse, known}).unsqueeze(1), sigma).squeeze(1);
  return planes[0] / planes[1].clamp_min(1e-6);
}

}  // namespace apvi::mapping
