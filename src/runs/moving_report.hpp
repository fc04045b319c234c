// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "eval/metrics_file.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/training/robust_weights.hpp"

namespace apvi::runs {

class SimulatedTruth;

/// Writes the pixels whose weight was lowered last, STAMP.png of every training keyframe, into a
/// new folder; returns their fraction, and with `truth` (may be null) the fractions of pixels that
/// show a moving body, `of_moving`, and of those that show nothing that moves, `of_static`.
eval::Json report_moving(const mapping::RobustWeights& weights,
                         const mapping::KeyframeStore& keyframes,
                         const std::filesystem::path& folder, const SimulatedTruth* truth);

}  // namespace apvi::runs
