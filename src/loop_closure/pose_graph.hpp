// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
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

/// How an edge that is not in a graph agrees with it.
struct EdgeCheck {
  /// d² = rᵀ (C + I)⁻¹ r with four degrees of freedom, with the residuals r of the edge in sigmas
  /// and their covariance C = J Σ Jᵀ by the covariance Σ of the nodes.
  double squared_distance = 0.0;
  /// Squared length of the change C (C + I)⁻¹ r that the edge would make to its residuals: small
  /// where the graph knows the relative pose much better than the edge does.
  double news = 0.0;
};

/// A graph linearized at its corrections, with the covariance of its nodes. Its loops count as
/// their robust loss weights them. Keeps a copy of the graph.
class LinearGraph {
 public:
  LinearGraph(PoseGraph graph, const std::vector<DriftCorrection>& corrections);
  ~LinearGraph();
  LinearGraph(LinearGraph&&) noexcept;
  LinearGraph& operator=(LinearGraph&&) noexcept;

  /// Of an edge between its nodes. Both are infinite if the graph does not determine the nodes and
  /// the edge is not met exactly.
  EdgeCheck check(const Edge& edge) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace apvi::loop_closure
