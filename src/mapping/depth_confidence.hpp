// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "apvi/mapping/depth_options.hpp"

namespace apvi::mapping {

/// What speaks for and against the depth of each block, [B] float32 each.
struct BlockEvidence {
  torch::Tensor cost;            ///< photometric, at the depth chosen
  torch::Tensor margin;          ///< by how much the best cost elsewhere is worse; may be negative
  torch::Tensor relative_sigma;  ///< of the depth, from parallax alone
  torch::Tensor seen;            ///< pictures that see the point
  torch::Tensor agreement;       ///< part of the neighbours that have the same depth
};

/// Confidence [B] in [0, 1]: the product of what each piece of evidence leaves.
torch::Tensor confidence_of(const BlockEvidence& evidence, const ConfidenceOptions& options);

}  // namespace apvi::mapping
