// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "eval/association.hpp"
#include "eval/trajectory_metrics.hpp"

namespace apvi::eval {

/// The alignment transform. Not `determined` when the rotation is ambiguous, as for collinear
/// positions; the positions are then still aligned optimally.
struct Fit {
  SE3 T_reference_estimate;
  bool determined = true;
};

/// `pairs` must not be empty. A planar problem is rotated about the vertical only, since a free
/// rotation could flip the estimate and fit its mirror image.
Fit fit(const std::vector<PosePair>& pairs, Alignment alignment, bool planar);

}  // namespace apvi::eval
