// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "apvi/geometry/se3.hpp"

namespace apvi::loop {

/// What odometry drifts in: heading and place. Its tilt is measured, by gravity.
struct Correction {
  double heading = 0.0;                                   ///< about z, at the world's origin [rad]
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();  ///< then [m]

  /// From odometry's world to the corrected one.
  SE3 motion() const;
};

/// How well one knows where a pose is from another.
struct EdgeSigmas {
  double heading_rad = 0.0;
  double horizontal_m = 0.0;
  double vertical_m = 0.0;
};

/// Two poses of which a measurement says how they stand to each other.
struct Edge {
  std::size_t from = 0;
  std::size_t to = 0;
  SE3 T_from_to;
  EdgeSigmas sigmas;
  bool may_be_wrong = false;  ///< a loop: counts less the worse it fits
};

/// Most probable corrections (in and out) of `odometry`'s poses, given what is known between them;
/// the first stays. A pose graph of four degrees of freedom (Qin, Li, Shen, VINS-Mono, 2018,
/// section VIII), solved by Ceres. The vertical is z.
void optimise(const std::vector<SE3>& odometry, const std::vector<Edge>& edges,
              std::vector<Correction>& corrections);

/// How far an edge is from fitting, in sigmas: the root of its squared residuals' sum.
double misfit(const Edge& edge, const std::vector<SE3>& odometry,
              const std::vector<Correction>& corrections);

}  // namespace apvi::loop
