// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/geometry/trajectory.hpp"
#include "eval/metrics_file.hpp"
#include "runs/merge/merge_input.hpp"

namespace apvi::runs {

/// `poses`, with the slow part of the change that takes them to `corrected` at their stamps: means
/// over four seconds. Both describe one path; single poses of `corrected` are noisier. Poses
/// without a corrected one near them change like the others around them.
Trajectory moved_like(const Trajectory& poses, const Trajectory& corrected);

/// Moves the sessions into one frame, that of the first, by a pose graph over the places of all
/// (loop_closure::merge_sessions). Returns an object for each session: places, edges, rejected
/// edges and the RMS of the edges [m], before and after the optimization. Throws InputError for a
/// run without places, and for one that shares none with the others.
std::vector<eval::Json> join_frames(std::vector<MergeSession>& sessions);

}  // namespace apvi::runs
