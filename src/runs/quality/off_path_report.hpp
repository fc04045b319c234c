// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "eval/metrics_file.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/rendering.hpp"

namespace apvi::runs {

class SimulatedTruth;

/// Compares the map with the truth's images from beside the path of the held-out images, at the
/// gains of these, and adds the means to the `mapping` section of metrics.json. Renders and truth
/// are written into the folder. Adds nothing without such images.
void add_off_path_views(const mapping::Map& map, const mapping::KeyframeStore& keyframes,
                        const SimulatedTruth& truth, const std::filesystem::path& folder,
                        eval::Json& json);

}  // namespace apvi::runs
