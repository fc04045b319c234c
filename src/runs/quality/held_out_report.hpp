// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "eval/metrics_file.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/rendering.hpp"

namespace apvi::runs {

class SimulatedTruth;

/// Renders the held-out images into a folder (truth, render, depth, and restored with a medium) and
/// evaluates them: one line per image in views.csv there; returns their means, the `mapping`
/// section of metrics.json except for the map's own figures. With `truth` (may be null) depth and
/// restored images are evaluated too.
eval::Json report_held_out(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                           const std::filesystem::path& folder, const SimulatedTruth* truth);

}  // namespace apvi::runs
