// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vio/initialization/gyro_bias_from_rays.hpp"
#include "vio/initialization/start_problem.hpp"

namespace apvi::vio {

/// Initial motion and structure in the frame of the first keyframe body.
struct StartGuess {
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();   ///< of the given magnitude
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< at the first keyframe [m/s]
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();
  /// Per track, in the camera of its first view, along z [1/m]; not positive: unknown.
  std::vector<double> inverse_depth;
};

/// With known rotations, point projections are linear in velocity, gravity, accelerometer bias and
/// the points: least squares with the points eliminated and gravity on its sphere (Dong-Si and
/// Mourikis, "Estimator initialization in vision-aided inertial navigation with unknown camera-IMU
/// calibration", IROS 2012). Iterated with the estimated distances, so that errors are in pixels,
/// and with outlier tracks downweighted. `track_weights`: one per track. Nullopt if the system is
/// singular.
std::optional<StartGuess> closed_form_start(const StartProblem& problem,
                                            const Eigen::Vector3d& gyro_bias,
                                            const std::vector<double>& track_weights,
                                            const StartSigmas& sigmas);

/// The x of length `radius` that minimizes xᵀ S x + 2 sᵀ x, S symmetric.
Eigen::Vector3d minimize_on_sphere(const Eigen::Matrix3d& S, const Eigen::Vector3d& s,
                                   double radius);

}  // namespace apvi::vio
