// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "apvi/vio/frame_state.hpp"
#include "vio/start_problem.hpp"
#include "vio/start_refinement.hpp"

namespace apvi::vio {

/// The keyframes of a start after everything was solved for, in a world with z up, and how well
/// everything agrees.
struct SolvedStart {
  std::vector<FrameState> states;
  double reprojection_rms_px = 0.0;  ///< of the sightings that are believed
  double inlier_share = 0.0;         ///< of all sightings
  double scale_sigma = 0.0;          ///< relative, of the way to the farthest keyframe
  double inertial_rms = 0.0;         ///< of the inertial terms, one is as expected
  bool size_is_felt = false;         ///< the IMU contradicts twice the scale
  bool usable = false;
};

/// The refined start once more with the noise of the IMU: poses, velocities and biases of all
/// keyframes, inverse depths of all tracks. Where the refinement takes the IMU for exact, this
/// weighs it against the camera, and so the scale's sigma is what the measurements allow.
SolvedStart solve_start(const StartProblem& problem, const RefinedStart& start,
                        const StartSigmas& sigmas);

}  // namespace apvi::vio
