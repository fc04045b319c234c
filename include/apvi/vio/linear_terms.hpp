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

/// One block of a linearised problem. The tangent of seven numbers is a pose's (six), of any other
/// count the numbers themselves.
struct Block {
  double* data = nullptr;
  int size = 0;
  int tangent() const { return size == 7 ? 6 : size; }
};

/// Terms ‖r + Σ J_k δ_k‖² of a least squares problem, linearised where the blocks are. All numbers
/// lie in one array, so that a term costs no allocation of its own.
class LinearTerms {
 public:
  struct Variable {
    Block block;
    bool constant = false;
  };
  struct Part {
    int variable = 0;          ///< index into `variables`
    std::size_t jacobian = 0;  ///< where it begins
  };
  struct Term {
    std::size_t first_part = 0;
    std::size_t parts = 0;
    int rows = 0;
    std::size_t residual = 0;
  };
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  using Jacobian = Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>>;

  /// Evaluates a term, weighed down by `loss` (may be null) as Ceres does. False, and nothing
  /// added, when it cannot be evaluated or is not finite.
  bool add(const ceres::CostFunction& cost, const ceres::LossFunction* loss,
           std::span<const Block> blocks);
  /// Terms, earlier and later ones, have no derivative by this block.
  void hold_constant(const double* block);
  /// Forgets all terms and blocks, and keeps the memory.
  void clear();

  const std::vector<Variable>& variables() const { return variables_; }
  const std::vector<Term>& terms() const { return terms_; }
  std::span<const Part> parts(const Term& term) const {
    return std::span(parts_).subspan(term.first_part, term.parts);
  }
  /// By the tangent: rows x tangent.
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
  void weigh(const ceres::LossFunction& loss, const Term& term);

  std::vector<Variable> variables_;
  std::unordered_map<const double*, int> index_;
  std::vector<const double*> constants_;  // named before they appeared
  std::vector<Term> terms_;
  std::vector<Part> parts_;
  std::vector<double> numbers_;
  std::vector<const double*> parameters_;  // scratch
  std::vector<double*> jacobians_;         // scratch
};

}  // namespace apvi::vio
