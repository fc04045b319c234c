// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "medium/medium.hpp"

namespace apvi::medium {

/// Typical coastal water, the default where images contain no information.
Medium coastal_medium();

/// Initial estimate of the medium from a few images with ranges, accurate enough to start an
/// optimization. `colors[i]` [H,W,3] in [0, 1] as observed, `ranges[i]` [H,W] along the ray [m], 0
/// or not finite where unknown.
///
/// Assumes that surfaces have the same color distribution at all ranges. Then the contrast at range
/// z decays as exp(-beta_d z), a linear fit of its logarithm, and the darkest pixels, dominated by
/// backscatter, converge to b_inf as exp(-beta_b z), a linear fit for each candidate beta_b. Pixels
/// without range count as open water if their color is uniform. A channel without information keeps
/// the coastal values. float64 on the CPU. Throws c10::Error when shapes do not match.
Medium initialize_medium(const std::vector<torch::Tensor>& colors,
                         const std::vector<torch::Tensor>& ranges);

}  // namespace apvi::medium
