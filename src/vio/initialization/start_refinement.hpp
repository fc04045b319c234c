// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "imu/preintegration.hpp"
#include "vio/initialization/closed_form_start.hpp"
#include "vio/initialization/start_problem.hpp"

namespace apvi::vio {

/// Result of the nonlinear refinement. Order of the twelve parameters: gravity, velocity, gyro
/// bias, accelerometer bias, as in StartGuess.
struct RefinedStart {
  using Matrix12 = Eigen::Matrix<double, 12, 12>;

  StartGuess guess;
  Matrix12 covariance = Matrix12::Zero();  ///< singular along gravity, whose magnitude is given
  double rms_px = 0.0;                     ///< of the inlier observations
  double inlier_fraction = 0.0;            ///< inlier fraction of all observations
  /// Inlier views of each track including its first view, or none.
  std::vector<StartProblem::Track> tracks;
  std::vector<imu::Preintegration>
      motion;  ///< preintegration from the first keyframe to each, at the estimated biases
  bool converged = false;
};

/// Over one or two seconds inertial integration is accurate to a fraction of a pixel, so all
/// observations together determine gravity, velocity, the biases and one inverse depth per track.
/// Eleven degrees of freedom plus one per track; robust Levenberg-Marquardt.
RefinedStart refine_start(const StartProblem& problem, const StartGuess& guess,
                          const StartSigmas& sigmas);

/// Standard deviation of the logarithm of the path size (RMS distance of the keyframes from their
/// center).
double relative_scale_sigma(const RefinedStart& start);

}  // namespace apvi::vio
