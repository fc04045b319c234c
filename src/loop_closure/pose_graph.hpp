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

/// Absolute height of a node: that of the odometry, which pressure bounds.
struct Height {
  std::size_t node = 0;
  double sigma_m = 0.0;
};

/// A pose graph with four degrees of freedom per node (Qin, Li, Shen, VINS-Mono, 2018, section
/// VIII). z is vertical. The first pose is fixed.
struct PoseGraph {
  std::vector<SE3> odometry;  ///< poses of the nodes
  std::vector<Edge> edges;
  std::vector<Height> heights = {};
};

/// Maximum-likelihood corrections of the poses of the nodes, with Ceres. `corrections`, one per
/// node: initial values in, result out.
void optimize(const PoseGraph& graph, std::vector<DriftCorrection>& corrections);

/// Error of an edge in sigmas: the norm of its residuals.
double residual_norm(const PoseGraph& graph, const std::vector<DriftCorrection>& corrections,
                     const Edge& edge);

/// Squared Mahalanobis distance, with four degrees of freedom, of an edge that is not in the graph:
/// d² = rᵀ (J Σ Jᵀ + I)⁻¹ r, with its residuals r in sigmas, their Jacobian J and the covariance Σ
/// of the nodes by the graph, whose loops count as their robust loss weights them.
double squared_distance(const PoseGraph& graph, const std::vector<DriftCorrection>& corrections,
                        const Edge& edge);

}  // namespace apvi::loop_closure
