// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/pose_graph.hpp"

#include <ceres/ceres.h>

#include <array>
#include <cmath>

#include "apvi/geometry/so3.hpp"

namespace apvi::loop_closure {
namespace {

constexpr int kIterations = 20;
constexpr double kRobustSigmas = 3.0;  // scale of the Cauchy loss of loops, in sigmas

/// Heading of the correction and position of the corrected pose: a parameterization in which the
/// graph is nearly linear.
using Block = std::array<double, 4>;

/// Position of `to` relative to `from` in the heading of `from`, and the heading difference.
class EdgeResidual {
 public:
  EdgeResidual(const Edge& edge, const SE3& from, const SE3& to)
      : step_(from.rotation * edge.T_from_to.translation),
        turn_(so3::yaw(from.rotation * edge.T_from_to.rotation * to.rotation.conjugate())),
        weights_(1.0 / edge.sigmas.horizontal_m, 1.0 / edge.sigmas.horizontal_m,
                 1.0 / edge.sigmas.vertical_m),
        heading_weight_(1.0 / edge.sigmas.heading_rad) {}

  template <typename T>
  bool operator()(const T* from, const T* to, T* residuals) const {
    using std::cos;
    using std::sin;
    const T c = cos(from[0]);
    const T s = sin(from[0]);
    const T dx = to[1] - from[1];
    const T dy = to[2] - from[2];
    residuals[0] = weights_[0] * (c * dx + s * dy - step_[0]);
    residuals[1] = weights_[1] * (c * dy - s * dx - step_[1]);
    residuals[2] = weights_[2] * (to[3] - from[3] - step_[2]);
    residuals[3] = heading_weight_ * (to[0] - from[0] - turn_);
    return true;
  }

 private:
  Eigen::Vector3d step_;
  double turn_;
  Eigen::Vector3d weights_;
  double heading_weight_;
};

Block to_block(const DriftCorrection& correction, const SE3& pose) {
  const Eigen::Vector3d p = correction.transform() * pose.translation;
  return {correction.heading, p.x(), p.y(), p.z()};
}

DriftCorrection to_correction(const Block& block, const SE3& pose) {
  DriftCorrection correction{.heading = block[0]};
  correction.translation =
      Eigen::Vector3d(block[1], block[2], block[3]) - correction.transform() * pose.translation;
  return correction;
}

}  // namespace

SE3 DriftCorrection::transform() const {
  return {so3::exp({0.0, 0.0, heading}), translation};
}

void optimize_pose_graph(const std::vector<SE3>& odometry, const std::vector<Edge>& edges,
                         std::vector<DriftCorrection>& corrections) {
  if (odometry.size() < 2 || edges.empty()) return;
  std::vector<Block> blocks;
  for (std::size_t i = 0; i < odometry.size(); ++i) {
    blocks.push_back(to_block(corrections[i], odometry[i]));
  }
  ceres::Problem problem;
  for (const Edge& edge : edges) {
    auto* residual = new EdgeResidual(edge, odometry[edge.from], odometry[edge.to]);
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<EdgeResidual, 4, 4, 4>(residual),
                             edge.is_loop ? new ceres::CauchyLoss(kRobustSigmas) : nullptr,
                             blocks[edge.from].data(), blocks[edge.to].data());
  }
  if (problem.HasParameterBlock(blocks[0].data())) {
    problem.SetParameterBlockConstant(blocks[0].data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = kIterations;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return;
  for (std::size_t i = 0; i < odometry.size(); ++i) {
    corrections[i] = to_correction(blocks[i], odometry[i]);
  }
}

double residual_norm(const Edge& edge, const std::vector<SE3>& odometry,
                     const std::vector<DriftCorrection>& corrections) {
  const Block from = to_block(corrections[edge.from], odometry[edge.from]);
  const Block to = to_block(corrections[edge.to], odometry[edge.to]);
  Eigen::Vector4d residuals;
  EdgeResidual(edge, odometry[edge.from], odometry[edge.to])(from.data(), to.data(),
                                                             residuals.data());
  return residuals.norm();
}

}  // namespace apvi::loop_closure
