// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/fusion/config.hpp"
#include "fusion/semicircle.hpp"

namespace apvi::fusion {

/// Unnormalized eigenvalues of a recorded frame and the number of corners in its solution.
struct RecordedFrame {
  Eigenvalues eigenvalues;
  int inliers = 0;
};

/// Frames that step 3 should accept (steps 1 and 2 did), and frames whose window had no landmarks.
struct RecordedFrames {
  std::vector<RecordedFrame> healthy;
  std::vector<RecordedFrame> blind;
};

/// Effect of thresholds on a set of frames.
struct ThresholdOutcome {
  std::size_t frames = 0;
  double rejected = 0.0;           ///< fraction with an eigenvalue below its threshold
  double rejected_by_remap = 0.0;  ///< fraction with fewer than `min_directions` eigenvalues above
  double directions = 6.0;         ///< mean number of eigenvalues above their threshold
};

/// Thresholds for step 3 and their effect on the frames they were fitted to.
struct DegeneracyCalibration {
  Normalization normalization = Normalization::none;
  ThresholdFit fit;
  EigenThresholds thresholds;  ///< lower edges of the fit, or lower if those reject too much
  ThresholdOutcome healthy;
  ThresholdOutcome blind;
  ThresholdOutcome healthy_at_edge;  ///< with the lower edges as thresholds
  ThresholdOutcome blind_at_edge;
};

/// Eigenvalues of a frame, normalized as in step 3.
Eigenvalues normalized(const RecordedFrame& frame, Normalization normalization);

/// Applies given thresholds to frames.
ThresholdOutcome evaluate_thresholds(const std::vector<RecordedFrame>& frames,
                                     const EigenThresholds& thresholds, Normalization normalization,
                                     int min_directions);

/// Fits the lower edge of a semicircle to the eigenvalues of each block over the healthy frames. An
/// edge that rejects more than a fraction `max_false_alarm` / 2 of them is lowered until it does
/// not: a semicircle has no tails, recorded eigenvalues do. Nullopt for fewer than two frames.
std::optional<DegeneracyCalibration> calibrate_degeneracy(const RecordedFrames& frames,
                                                          Normalization normalization,
                                                          double max_false_alarm,
                                                          int min_directions);

}  // namespace apvi::fusion
