// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "apvi/depth/options.hpp"

namespace apvi::depth {

/// Evidence for the depth of each block, [B] float32 each.
struct BlockEvidence {
  torch::Tensor cost;            ///< photometric, at the selected depth
  torch::Tensor margin;          ///< best cost elsewhere minus the selected cost; may be negative
  torch::Tensor relative_sigma;  ///< relative depth uncertainty from parallax
  torch::Tensor seen;            ///< images that observe the point
  torch::Tensor agreement;       ///< fraction of neighbors on the same surface
};

/// Confidence [B] in [0, 1]: the product of a factor per kind of evidence.
torch::Tensor confidence_of(const BlockEvidence& evidence, const ConfidenceOptions& options);

}  // namespace apvi::depth
