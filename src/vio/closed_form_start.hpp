// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "vio/gyro_bias_from_rays.hpp"
#include "vio/start_problem.hpp"

namespace apvi::vio {

/// Motion and structure in the frame of the first keyframe's body.
struct StartGuess {
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero();   ///< [m/s²], of the given length
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  ///< of the first keyframe [m/s]
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();
  /// Of each track in the camera of its first view, along z [1/m]; not positive: unknown.
  std::vector<double> inverse_depth;
};

/// With the rotations known the projection of points is linear in velocity, gravity,
/// accelerometer bias and the points: least squares with the points eliminated and gravity on its
/// sphere (Dong-Si and Mourikis, "Estimator initialization in vision-aided inertial navigation with
/// unknown camera-IMU calibration", IROS 2012). Repeated with the distances found, so that errors
/// count as pixels, and with less weight for tracks that do not fit. `belief`: of each track.
/// Nothing when the system is singular.
std::optional<StartGuess> closed_form_start(const StartProblem& problem,
                                            const Eigen::Vector3d& gyro_bias,
                                            const std::vector<double>& belief,
                                            const StartSigmas& sigmas);

/// The x of length `radius` that minimises xᵀ S x + 2 sᵀ x, S symmetric.
Eigen::Vector3d minimize_on_sphere(const Eigen::Matrix3d& S, const Eigen::Vector3d& s,
                                   double radius);

}  // namespace apvi::vio
