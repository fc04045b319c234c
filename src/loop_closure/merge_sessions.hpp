// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "loop_closure/session_graph.hpp"

namespace apvi::loop_closure {

/// Where a session lies in the joint frame, which is that of the first session.
struct MergedSession {
  bool found = false;         ///< if not, nothing is known of where it lies
  std::size_t edges = 0;      ///< of its places, to sessions placed before it
  std::size_t rejected = 0;   ///< such edges that the graph contradicted
  double rms_placed_m = 0.0;  ///< of these edges, with every session moved as a whole
  double rms_m = 0.0;         ///< of these edges, in the result
  SessionPath path;           ///< the corrections of its poses
};

/// Merges sessions into one frame: the places of a session are searched in the maps of those
/// already placed, from the first one on, at any heading and position, as relocalization does. Then
/// each of its places is predicted there and fixed, and one pose graph over the nodes of all placed
/// sessions is optimized, with the trajectories as relative edges and the fixes as robust loops.
///
/// Precision over recall: several places must agree to find a session, a fix must agree with the
/// graph, and a session is given up if its fixes contradict each other. Deterministic. The sessions
/// may be in any order and of any number. Throws InputError for a trajectory without poses.
std::vector<MergedSession> merge_sessions(const std::vector<Session>& sessions,
                                          const SessionGraph::Options& options = {});

}  // namespace apvi::loop_closure
