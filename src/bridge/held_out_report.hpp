// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "apvi/eval/metrics_file.hpp"
#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/rendering.hpp"

namespace apvi::bridge {

class SimulatedTruth;

/// Draws the held-out images into a folder (truth, render, depth, and restored with water) and
/// measures them: each in a line of views.csv there, and their means, the `mapping` section of
/// metrics.json but for the map's own figures. With `truth` (may be null) depth and the restored
/// images are measured too.
eval::Json report_held_out(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                           const std::filesystem::path& folder, const SimulatedTruth* truth);

}  // namespace apvi::bridge
