// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "imu/preintegration.hpp"
#include "vio/initialization/closed_form_start.hpp"
#include "vio/initialization/start_problem.hpp"

namespace apvi::vio {

/// Result of the nonlinear refinement.
struct RefinedStart {
  StartGuess guess;
  double inlier_fraction = 0.0;  ///< of all observations
  /// Inlier views of each track including its first view, or none.
  std::vector<StartProblem::Track> tracks;
  std::vector<imu::Preintegration>
      motion;  ///< preintegration from the first keyframe to each, at the estimated biases
};

/// Over one or two seconds inertial integration is accurate to a fraction of a pixel, so all
/// observations together determine gravity, velocity, the biases and one inverse depth per track.
/// Eleven degrees of freedom plus one per track; robust Levenberg-Marquardt.
RefinedStart refine_start(const StartProblem& problem, const StartGuess& guess,
                          const StartSigmas& sigmas);

}  // namespace apvi::vio
