// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "vio/start_problem.hpp"

namespace apvi::vio {

/// How sure a start may be of its sensors before it has seen anything.
struct StartSigmas {
  double gyro_bias = 0.1;   ///< [rad/s]
  double accel_bias = 0.2;  ///< [m/s²]
  double pixel = 1.0;       ///< of a corner [px]
  double focal_px = 460.0;  ///< turns angles into pixels
};

struct GyroBias {
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();   ///< [rad/s]
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();  ///< [rad/s]
  double rms_px = 0.0;                              ///< robust, off the epipolar planes
  std::vector<double> belief;                       ///< of each track, in [0, 1]
};

/// The bias with which the gyro turns the rays of every two keyframes such that one translation
/// explains them: the sum of the smallest eigenvalues of M = Σ n nᵀ, n = f_i × R f_j, is least.
/// Needs neither translation nor depth. Kneip and Lynen, "Direct optimization of frame-to-frame
/// rotation", ICCV 2013; He et al., "A rotation-translation-decoupled solution for robust and
/// efficient visual-inertial initialization", CVPR 2023. Tracks that do not fit lose their weight.
GyroBias find_gyro_bias(const StartProblem& problem, const StartSigmas& sigmas);

}  // namespace apvi::vio
