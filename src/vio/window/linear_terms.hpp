// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <unordered_map>
#include <vector>

namespace apvi::vio {

/// A parameter block of a linearized problem. A block of seven numbers is a pose with a tangent of
/// six; any other block is Euclidean.
struct Block {
  double* data = nullptr;
  int size = 0;
  int tangent() const { return size == 7 ? 6 : size; }
};

/// Terms ‖r + Σ J_k δ_k‖² of a least-squares problem, linearized at the current block values. All
/// numbers are stored in one array, so that terms need no allocations of their own.
class LinearTerms {
 public:
  struct Variable {
    Block block;
    bool constant = false;
  };
  struct Part {
    int variable = 0;          ///< index in `variables`
    std::size_t jacobian = 0;  ///< offset of the Jacobian in the number array
  };
  struct Term {
    std::size_t first_part = 0;
    std::size_t parts = 0;
    int rows = 0;
    std::size_t residual = 0;
  };
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  using Jacobian = Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>>;

  /// Evaluates and adds a term with a robust `loss` (may be null), as Ceres does. Returns false and
  /// adds nothing if the evaluation fails or is not finite.
  bool add(const ceres::CostFunction& cost, const ceres::LossFunction* loss,
           std::span<const Block> blocks);
  /// Holds a block constant: no term has a derivative by it.
  void hold_constant(const double* block);
  /// Removes all terms and blocks but keeps the memory.
  void clear();

  const std::vector<Variable>& variables() const { return variables_; }
  const std::vector<Term>& terms() const { return terms_; }
  std::span<const Part> parts(const Term& term) const {
    return std::span(parts_).subspan(term.first_part, term.parts);
  }
  /// By the tangent: rows x tangent size.
  Jacobian jacobian(const Term& term, const Part& part) const {
    const Block& block = variables_[static_cast<std::size_t>(part.variable)].block;
    return {numbers(part.jacobian), term.rows, block.tangent(), Eigen::OuterStride<>(block.size)};
  }
  Eigen::Map<const Eigen::VectorXd> residual(const Term& term) const {
    return {numbers(term.residual), term.rows};
  }
  const double* numbers(std::size_t at) const { return numbers_.data() + at; }

 private:
  int variable_of(const Block& block);
  bool evaluate(const ceres::CostFunction& cost, const Term& term, std::span<const Block> blocks);
  void apply_loss(const ceres::LossFunction& loss, const Term& term);

  std::vector<Variable> variables_;
  std::unordered_map<const double*, int> index_;
  std::vector<const double*> constants_;  // constant blocks that have not appeared yet
  std::vector<Term> terms_;
  std::vector<Part> parts_;
  std::vector<double> numbers_;
  std::vector<const double*> parameters_;  // scratch
  std::vector<double*> jacobians_;         // scratch
};

}  // namespace apvi::vio
