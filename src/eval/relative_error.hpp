// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "eval/association.hpp"

namespace apvi::eval {

/// Index pairs: start and end of a relative motion.
using IndexPairs = std::vector<std::pair<std::size_t, std::size_t>>;

/// From every pose to the one `seconds` later (nearest, tolerance 10 %).
IndexPairs pairs_by_time(const std::vector<PosePair>& pairs, double seconds);
/// Consecutive pairs, each spanning `distance_m` of the estimated path. The first one starts
/// `distance_m` into the path, as in evo.
IndexPairs consecutive_pairs_by_path(const std::vector<PosePair>& pairs, double distance_m);
/// From every pose to the one `distance_m` further along the estimated path (tolerance 10 %).
IndexPairs all_pairs_by_path(const std::vector<PosePair>& pairs, double distance_m);

/// Length of the translation of (ref_i^-1 ref_j)^-1 (est_i^-1 est_j) for every pair [m]; Sturm et
/// al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, Eq. 2.
std::vector<double> relative_errors(const std::vector<PosePair>& pairs, const IndexPairs& indices);

}  // namespace apvi::eval
