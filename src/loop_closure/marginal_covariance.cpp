// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/marginal_covariance.hpp"

#include <ceres/ceres.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <iterator>

namespace apvi::loop_closure {
namespace {

using Sparse = Eigen::SparseMatrix<double>;

// The asked blocks come last.
std::vector<double*> order_of(const ceres::Problem& problem, const std::vector<double*>& asked) {
  std::vector<double*> all;
  problem.GetParameterBlocks(&all);
  std::erase_if(all, [&](double* block) {
    return problem.IsParameterBlockConstant(block) ||
           std::ranges::find(asked, block) != asked.end();
  });
  std::ranges::copy_if(asked, std::back_inserter(all),
                       [&](double* block) { return !problem.IsParameterBlockConstant(block); });
  return all;
}

std::optional<Sparse> information_of(ceres::Problem& problem,
                                     const std::vector<double*>& variables) {
  ceres::Problem::EvaluateOptions options;
  options.parameter_blocks = variables;
  ceres::CRSMatrix rows;
  if (!problem.Evaluate(options, nullptr, nullptr, nullptr, &rows)) return std::nullopt;
  const Eigen::Map<const Eigen::SparseMatrix<double, Eigen::RowMajor>> J(
      rows.num_rows, rows.num_cols, static_cast<Eigen::Index>(rows.values.size()), rows.rows.data(),
      rows.cols.data(), rows.values.data());
  return Sparse(J.transpose() * J);
}

// Columns of the components of the asked blocks among all asked ones, without constant ones.
std::vector<Eigen::Index> free_components(const ceres::Problem& problem,
                                          const std::vector<double*>& asked, Eigen::Index& size) {
  std::vector<Eigen::Index> components;
  size = 0;
  for (const double* block : asked) {
    const int tangent = problem.ParameterBlockTangentSize(block);
    for (int k = 0; k < tangent; ++k, ++size) {
      if (!problem.IsParameterBlockConstant(block)) components.push_back(size);
    }
  }
  return components;
}

}  // namespace

std::optional<Eigen::MatrixXd> marginal_covariance(ceres::Problem& problem,
                                                   const std::vector<double*>& blocks) {
  Eigen::Index size = 0;
  const std::vector<Eigen::Index> components = free_components(problem, blocks, size);
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
  if (components.empty()) return covariance;
  const auto information = information_of(problem, order_of(problem, blocks));
  if (!information) return std::nullopt;
  const Eigen::SimplicialLLT<Sparse> factored(*information);
  if (factored.info() != Eigen::Success) return std::nullopt;
  const auto asked = static_cast<Eigen::Index>(components.size());
  Eigen::MatrixXd unit = Eigen::MatrixXd::Zero(information->rows(), asked);
  unit.bottomRows(asked).setIdentity();
  const Eigen::MatrixXd solved = factored.solve(unit);
  covariance(components, components) = solved.bottomRows(asked);
  return covariance;
}

}  // namespace apvi::loop_closure
