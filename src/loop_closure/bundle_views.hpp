// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "loop_closure/bundle_adjustment.hpp"
#include "loop_closure/keyframe_graph.hpp"
#include "loop_closure/place_store.hpp"

namespace apvi::loop_closure {

/// The places of a dive as views of a bundle adjustment, with what the graph knows of them. Motions
/// between neighbors count with the sigmas that odometry reports, without `drift_factor`, which is
/// of long spans. Motions, roll and pitch count less where odometry mounted the camera otherwise
/// than in the end: the errors of a calibration that changed later are shared by all of them.
std::vector<BundleView> bundle_views(const KeyframeGraph& graph,
                                     const std::vector<const PlaceStore::Stored*>& places,
                                     double drift_factor);

}  // namespace apvi::loop_closure
