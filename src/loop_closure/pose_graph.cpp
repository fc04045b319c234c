// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/pose_graph.hpp"

#include <ceres/ceres.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <limits>
#include <utility>

#include "apvi/geometry/so3.hpp"
#include "loop_closure/factors.hpp"

namespace apvi::loop_closure {
namespace {

constexpr int kIterations = 20;
constexpr double kRobustSigmas = 3.0;  // scale of the Cauchy loss of loops, in sigmas

std::vector<NodeState> to_states(const PoseGraph& graph,
                                 const std::vector<DriftCorrection>& corrections) {
  std::vector<NodeState> states;
  for (std::size_t i = 0; i < graph.odometry.size(); ++i) {
    states.push_back(to_state(corrections[i], graph.odometry[i]));
  }
  return states;
}

EdgeFactor factor_of(const PoseGraph& graph, const Edge& edge) {
  return {edge, graph.odometry[edge.from], graph.odometry[edge.to]};
}

void add_factors(const PoseGraph& graph, std::vector<NodeState>& states, ceres::Problem& problem) {
  for (const Edge& edge : graph.edges) {
    problem.AddResidualBlock(new EdgeFactor(factor_of(graph, edge)),
                             edge.is_loop ? new ceres::CauchyLoss(kRobustSigmas) : nullptr,
                             states[edge.from].data(), states[edge.to].data());
  }
  for (const Height& height : graph.heights) {
    problem.AddResidualBlock(new HeightFactor(height, graph.odometry[height.node]), nullptr,
                             states[height.node].data());
  }
  if (problem.HasParameterBlock(states[0].data())) {
    problem.SetParameterBlockConstant(states[0].data());
  }
}

using RowMatrix4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;

struct LinearEdge {
  Eigen::Vector4d residuals;
  RowMatrix4 from, to;  // Jacobians
};

LinearEdge linearize(const PoseGraph& graph, const std::vector<NodeState>& states,
                     const Edge& edge) {
  LinearEdge linear;
  const std::array<const double*, 2> at{states[edge.from].data(), states[edge.to].data()};
  std::array<double*, 2> jacobians{linear.from.data(), linear.to.data()};
  factor_of(graph, edge).Evaluate(at.data(), linear.residuals.data(), jacobians.data());
  return linear;
}

/// The information of all nodes but the first, which is fixed: the lower triangle.
class Information {
 public:
  explicit Information(std::size_t nodes) : size_(4 * static_cast<int>(nodes - 1)) {}

  void add(const Edge& edge, const LinearEdge& linear, double weight) {
    add(edge.from, edge.from, weight * linear.from.transpose() * linear.from);
    add(edge.to, edge.to, weight * linear.to.transpose() * linear.to);
    const Eigen::Matrix4d cross = weight * linear.to.transpose() * linear.from;
    edge.to > edge.from ? add(edge.to, edge.from, cross)
                        : add(edge.from, edge.to, cross.transpose());
  }
  void add_height(const Height& height) {
    Eigen::Matrix4d block = Eigen::Matrix4d::Zero();
    block(3, 3) = 1.0 / (height.sigma_m * height.sigma_m);
    add(height.node, height.node, block);
  }
  Eigen::SparseMatrix<double> matrix() const {
    Eigen::SparseMatrix<double> H(size_, size_);
    H.setFromTriplets(entries_.begin(), entries_.end());
    return H;
  }
  /// The transposed Jacobian of an edge by all nodes.
  Eigen::MatrixX4d transposed(const Edge& edge, const LinearEdge& linear) const {
    Eigen::MatrixX4d J = Eigen::MatrixX4d::Zero(size_, 4);
    if (edge.from > 0) J.middleRows<4>(first(edge.from)) = linear.from.transpose();
    if (edge.to > 0) J.middleRows<4>(first(edge.to)) = linear.to.transpose();
    return J;
  }

 private:
  static int first(std::size_t node) { return 4 * (static_cast<int>(node) - 1); }
  void add(std::size_t row, std::size_t column, const Eigen::Matrix4d& block) {
    if (row == 0 || column == 0) return;
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) {
        if (row != column || i >= j) {
          entries_.emplace_back(first(row) + i, first(column) + j, block(i, j));
        }
      }
    }
  }

  int size_;
  std::vector<Eigen::Triplet<double>> entries_;
};

// Weight of a loop under its robust loss: the derivative of the loss.
double robust_weight(const Edge& edge, const LinearEdge& linear) {
  if (!edge.is_loop) return 1.0;
  return 1.0 / (1.0 + linear.residuals.squaredNorm() / (kRobustSigmas * kRobustSigmas));
}

}  // namespace

SE3 DriftCorrection::transform() const {
  return {so3::exp({0.0, 0.0, heading}), translation};
}

void optimize(const PoseGraph& graph, std::vector<DriftCorrection>& corrections) {
  if (graph.odometry.size() < 2 || graph.edges.empty()) return;
  std::vector<NodeState> states = to_states(graph, corrections);
  ceres::Problem problem;
  add_factors(graph, states, problem);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = kIterations;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return;
  for (std::size_t i = 0; i < states.size(); ++i) {
    corrections[i] = to_correction(states[i], graph.odometry[i]);
  }
}

double residual_norm(const PoseGraph& graph, const std::vector<DriftCorrection>& corrections,
                     const Edge& edge) {
  return linearize(graph, to_states(graph, corrections), edge).residuals.norm();
}

struct LinearGraph::State {
  State(PoseGraph of, const std::vector<DriftCorrection>& corrections)
      : graph(std::move(of)),
        states(to_states(graph, corrections)),
        information(corrections.size()) {
    for (const Edge& edge : graph.edges) {
      const LinearEdge linear = linearize(graph, states, edge);
      information.add(edge, linear, robust_weight(edge, linear));
    }
    for (const Height& height : graph.heights) information.add_height(height);
    factored.compute(information.matrix());
  }

  PoseGraph graph;
  std::vector<NodeState> states;
  Information information;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factored;

  /// J Σ Jᵀ; infinite if the graph does not determine the nodes.
  Eigen::Matrix4d covariance(const Edge& edge, const LinearEdge& linear) const {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    if (factored.info() != Eigen::Success) return kInfinity * Eigen::Matrix4d::Identity();
    const Eigen::MatrixX4d J = information.transposed(edge, linear);
    return J.transpose() * factored.solve(J);
  }
};

LinearGraph::LinearGraph(PoseGraph graph, const std::vector<DriftCorrection>& corrections)
    : state_(std::make_unique<State>(std::move(graph), corrections)) {}

LinearGraph::~LinearGraph() = default;
LinearGraph::LinearGraph(LinearGraph&&) noexcept = default;
LinearGraph& LinearGraph::operator=(LinearGraph&&) noexcept = default;

EdgeCheck LinearGraph::check(const Edge& edge) const {
  const LinearEdge linear = linearize(state_->graph, state_->states, edge);
  const Eigen::Matrix4d covariance = state_->covariance(edge, linear);
  const Eigen::Vector4d weighted =
      (covariance + Eigen::Matrix4d::Identity()).ldlt().solve(linear.residuals);
  return {.squared_distance = linear.residuals.dot(weighted),
          .news = (covariance * weighted).squaredNorm()};
}

}  // namespace apvi::loop_closure
