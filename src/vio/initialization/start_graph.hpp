// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "vio/initialization/start_problem.hpp"
#include "vio/initialization/start_refinement.hpp"
#include "vio/window/frame_state.hpp"

namespace apvi::vio {

/// Solution of the full initialization problem in a world with z up, and its quality.
struct SolvedStart {
  std::vector<FrameState> states;
  double reprojection_rms_px = 0.0;  ///< of the inlier observations
  double inlier_fraction = 0.0;      ///< inlier fraction of all observations
  double scale_sigma = 0.0;   ///< relative sigma of the displacement to the farthest keyframe
  double inertial_rms = 0.0;  ///< RMS of the whitened inertial residuals, expected to be one
  bool scale_is_observable = false;  ///< the IMU rejects a doubled scale
  bool usable = false;
};

/// Solves the refined start again with IMU noise: poses, velocities and biases of all keyframes and
/// inverse depths of all tracks. Unlike the refinement, which takes the IMU as exact, this gives a
/// realistic scale uncertainty.
SolvedStart solve_start(const StartProblem& problem, const RefinedStart& start,
                        const StartSigmas& sigmas);

}  // namespace apvi::vio
