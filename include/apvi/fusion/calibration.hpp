// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "apvi/fusion/config.hpp"
#include "apvi/fusion/semicircle.hpp"

namespace apvi::fusion {

/// Eigenvalues of recorded frames, as they are, with the number of corners in each solution.
struct RecordedFrame {
  Eigenvalues eigenvalues;
  int inliers = 0;
};

/// Frames that step 3 should let pass (steps 1 and 2 did), and frames whose window saw nothing.
struct RecordedFrames {
  std::vector<RecordedFrame> healthy;
  std::vector<RecordedFrame> blind;
};

/// What thresholds do to one kind of frames.
struct FineOutcome {
  std::size_t frames = 0;
  double rejected = 0.0;           ///< share with an eigenvalue below its threshold
  double rejected_by_remap = 0.0;  ///< share with fewer than `min_directions` above it
  double directions = 6.0;         ///< mean number of those above
};

/// Thresholds for step 3 and how they do on the frames that they came from.
struct FineCalibration {
  Normalisation normalisation = Normalisation::none;
  ThresholdFit fit;
  EigenThresholds thresholds;  ///< the fit's edges, or less where they would reject too much
  FineOutcome healthy;
  FineOutcome blind;
  FineOutcome healthy_at_edge;  ///< had the thresholds been the edges
  FineOutcome blind_at_edge;
};

/// Eigenvalues of a frame as step 3 would test them.
Eigenvalues normalised(const RecordedFrame& frame, Normalisation normalisation);

/// Tests frames without fitting anything.
FineOutcome outcome(const std::vector<RecordedFrame>& frames, const EigenThresholds& thresholds,
                    Normalisation normalisation, int min_directions);

/// Fits the semicircle's lower edge to the eigenvalues of each block of healthy frames. An edge
/// that would reject more than half of `max_false_alarm` of them is lowered until it does not: a
/// semicircle has no tails, and recorded eigenvalues have. Nothing for fewer than two frames.
std::optional<FineCalibration> calibrate_fine(const RecordedFrames& frames,
                                              Normalisation normalisation, double max_false_alarm,
                                              int min_directions);

}  // namespace apvi::fusion
