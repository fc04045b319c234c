// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/motion/motion.hpp"

/// The geometry of a path, before it becomes a motion.
namespace apvi::sim {

/// Spacing of the points of a dense path [m].
inline constexpr double kPathStep = 0.05;

/// The corners of one round of the configured pattern (not for hover and file). Throws InputError
/// when it has no extent.
std::vector<Eigen::Vector3d> pattern_corners(const MotionConfig& config);

/// Points every `kPathStep` along the corners, repeated until `length_m` is covered, at the
/// configured altitude where one is set, corners rounded.
std::vector<Eigen::Vector3d> dense_path(const MotionConfig& config, double length_m,
                                        const HeightFunction& height);

/// Gaussian smoothing (three moving averages) of standard deviation `sigma` samples; the ends stay.
void smooth(std::vector<Eigen::Vector3d>& values, double sigma);
void smooth(std::vector<double>& values, double sigma);

}  // namespace apvi::sim
