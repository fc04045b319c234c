// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/sized_cost_function.h>

#include <array>

#include "loop_closure/pose_graph.hpp"

namespace apvi::loop_closure {

/// State of a node: heading of the correction [rad] and position of the corrected pose [m], in
/// which the graph is nearly linear.
using NodeState = std::array<double, 4>;

NodeState to_state(const DriftCorrection& correction, const SE3& odometry);
DriftCorrection to_correction(const NodeState& state, const SE3& odometry);

/// Error of an edge in sigmas: position of `to` relative to `from` in the heading of `from`, and
/// difference of heading. With R_z(ψ) of the correction of `from` and measured values of the edge,
/// r = ((R_z(-ψ_i)(p_j - p_i) - Δp_ij) / σ_p, (ψ_j - ψ_i - Δψ_ij) / σ_ψ).
class EdgeFactor : public ceres::SizedCostFunction<4, 4, 4> {
 public:
  EdgeFactor(const Edge& edge, const SE3& from, const SE3& to);
  bool Evaluate(double const* const* states, double* residuals, double** jacobians) const override;

 private:
  Eigen::Vector3d step_;
  double turn_;
  Eigen::Vector4d weights_;
};

/// Error of a height in sigmas: (z - z_odometry) / σ.
class HeightFactor : public ceres::SizedCostFunction<1, 4> {
 public:
  HeightFactor(const Height& height, const SE3& odometry);
  bool Evaluate(double const* const* states, double* residuals, double** jacobians) const override;

 private:
  double z_;
  double weight_;
};

}  // namespace apvi::loop_closure
