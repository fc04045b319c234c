// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "vio/initialization/start_problem.hpp"

namespace apvi::vio {

/// Prior uncertainty of an initialization.
struct StartSigmas {
  double gyro_bias = 0.1;   ///< [rad/s]
  double accel_bias = 0.2;  ///< [m/s²]
  double pixel = 1.0;       ///< of a corner [px]
  double focal_px = 460.0;  ///< converts angles to pixels
};

struct GyroBias {
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();   ///< [rad/s]
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();  ///< [rad/s]
  double rms_px = 0.0;                              ///< robust RMS of the epipolar residuals
  std::vector<double> track_weights;                ///< weight of each track, in [0, 1]
};

/// The gyro bias for which the rotated rays of all keyframe pairs are best explained by one
/// translation each: it minimizes the sum of the smallest eigenvalues of M = Σ n nᵀ, n = f_i × R
/// f_j. Needs neither translation nor depth. Kneip and Lynen, "Direct optimization of
/// frame-to-frame rotation", ICCV 2013; He et al., "A rotation-translation-decoupled solution for
/// robust and efficient visual-inertial initialization", CVPR 2023. Outlier tracks are
/// downweighted.
GyroBias find_gyro_bias(const StartProblem& problem, const StartSigmas& sigmas);

}  // namespace apvi::vio
