// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "apvi/eval/association.hpp"

namespace apvi::eval {

/// Indices of the two ends of a relative motion.
using IndexPairs = std::vector<std::pair<std::size_t, std::size_t>>;

/// From every pose to the one `seconds` later (nearest, within a tenth).
IndexPairs pairs_by_time(const std::vector<PosePair>& pairs, double seconds);
/// Pair after pair, each ending where the path of the estimate has grown by `metres`. The first one
/// starts where the first such stretch ends.
IndexPairs consecutive_pairs_by_path(const std::vector<PosePair>& pairs, double metres);
/// From every pose to the one `metres` further along the path of the estimate (within a tenth).
IndexPairs all_pairs_by_path(const std::vector<PosePair>& pairs, double metres);

/// Length of the translation of (ref_i^-1 ref_j)^-1 (est_i^-1 est_j) for every pair [m]; Sturm et
/// al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, Eq. 2.
std::vector<double> relative_errors(const std::vector<PosePair>& pairs, const IndexPairs& indices);

}  // namespace apvi::eval
