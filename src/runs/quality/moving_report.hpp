// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>
#include <vector>

#include "eval/metrics_file.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/training/robust_weights.hpp"

namespace apvi::runs {

class SimulatedTruth;

/// A connected region of an image that shows what moves.
struct MovingRegion {
  int left = 0, top = 0, width = 0, height = 0;  ///< [px]
  int pixels = 0;
};
/// The regions of lowered pixels, bool [H,W], of at least a thousandth of the image, the larger
/// ones first.
std::vector<MovingRegion> moving_regions(const torch::Tensor& lowered);

/// Writes the pixels whose weight was lowered last, STAMP.png of every training keyframe, into a
/// new folder, and their regions as regions.csv; returns their fraction, and with `truth` (may be
/// null) the fractions of pixels that show a moving body, `of_moving`, and of those that show
/// nothing that moves, `of_static`.
eval::Json report_moving(const mapping::RobustWeights& weights,
                         const mapping::KeyframeStore& keyframes,
                         const std::filesystem::path& folder, const SimulatedTruth* truth);

}  // namespace apvi::runs
