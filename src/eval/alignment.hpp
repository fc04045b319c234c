// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/eval/association.hpp"
#include "apvi/eval/trajectory_metrics.hpp"

namespace apvi::eval {

/// The motion that takes the estimate to the reference. Not `determined` when another rotation
/// would do as well, as for positions on a line; the positions then still fit as closely as they
/// can.
struct Fit {
  SE3 T_reference_estimate;
  bool determined = true;
};

/// `pairs` is not empty. A planar problem is turned about the vertical only, for in the plane a
/// free rotation can turn the estimate upside down and fit its mirror image.
Fit fit(const std::vector<PosePair>& pairs, Alignment alignment, bool planar);

}  // namespace apvi::eval
