// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "apvi/geometry/se3.hpp"

namespace apvi::loop_closure {

/// Drift of the odometry in heading and position. Roll and pitch are observable from gravity.
struct DriftCorrection {
  double heading = 0.0;  ///< rotation about z through the world origin [rad]
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();  ///< applied after the rotation [m]

  /// Transform from the odometry frame to the corrected frame.
  SE3 transform() const;
};

/// Uncertainty of a relative pose, one sigma.
struct EdgeSigmas {
  double heading_rad = 0.0;
  double horizontal_m = 0.0;
  double vertical_m = 0.0;
};

/// Measured relative pose of two nodes.
struct Edge {
  std::size_t from = 0;
  std::size_t to = 0;
  SE3 T_from_to;
  EdgeSigmas sigmas;
  bool is_loop = false;  ///< loop closures get a robust loss
};

/// Maximum-likelihood corrections (input: initial values, output: result) of the `odometry` poses;
/// the first pose is fixed. A pose graph with four degrees of freedom per node (Qin, Li, Shen,
/// VINS-Mono, 2018, section VIII), solved with Ceres. z is vertical.
void optimize_pose_graph(const std::vector<SE3>& odometry, const std::vector<Edge>& edges,
                         std::vector<DriftCorrection>& corrections);

/// Error of an edge in sigmas: the norm of its residuals.
double residual_norm(const Edge& edge, const std::vector<SE3>& odometry,
                     const std::vector<DriftCorrection>& corrections);

}  // namespace apvi::loop_closure
