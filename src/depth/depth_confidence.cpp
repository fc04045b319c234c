// SPDX-License-Identifier: BSD-3-Clause
#include "depth/depth_confidence.hpp"

#include <torch/torch.h>

namespace apvi::depth {

torch::Tensor confidence_of(const BlockEvidence& evidence, const ConfidenceOptions& options) {
  const torch::Tensor match = ((options.half_confidence_cost - evidence.cost) / 0.1).sigmoid();
  const torch::Tensor unique = (evidence.margin / options.uniqueness_margin).clamp(0.0, 1.0);
  const torch::Tensor precise =
      (2.0 - evidence.relative_sigma / options.max_relative_sigma).clamp(0.0, 1.0);
  const torch::Tensor seen = (evidence.seen >= 2).to(torch::kFloat32);
  const torch::Tensor agreed = (evidence.agreement / options.neighbor_fraction).clamp(0.0, 1.0);
  return match * unique * precise * seen * agreed;
}

}  // namespace apvi::depth
