// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "apvi/imu/preintegration.hpp"
#include "vio/closed_form_start.hpp"
#include "vio/start_problem.hpp"

namespace apvi::vio {

/// A start after the nonlinear solve, and how sure it is. Order of the twelve numbers: gravity,
/// velocity, gyro bias, accelerometer bias, as in StartGuess.
struct RefinedStart {
  using Matrix12 = Eigen::Matrix<double, 12, 12>;

  StartGuess guess;
  Matrix12 covariance = Matrix12::Zero();  ///< singular along gravity, whose length is given
  double rms_px = 0.0;                     ///< of the sightings that are believed
  double inlier_share = 0.0;               ///< of all sightings
  /// Of each track, what is believed: its views, the first among them, or none.
  std::vector<StartProblem::Track> tracks;
  std::vector<imu::Preintegration> motion;  ///< from the first keyframe to each, at the biases
  bool converged = false;
};

/// Over a second or two the inertial motion is exact to a fraction of a pixel, given where it
/// starts: all sightings together determine gravity, velocity, the biases and one inverse depth per
/// track. Eleven degrees of freedom and a depth a track, robust, by Levenberg-Marquardt.
RefinedStart refine_start(const StartProblem& problem, const StartGuess& guess,
                          const StartSigmas& sigmas);

/// One sigma of the logarithm of the path's size (root mean square distance of the keyframes from
/// their centre).
double relative_scale_sigma(const RefinedStart& start);

}  // namespace apvi::vio
