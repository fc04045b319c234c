// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "elimination.hpp"

namespace apvi::vio {

/// H = JᵀJ and b = Jᵀr in blocks that know which others they are linked to, and the elimination of
/// blocks from them. Only the lower half of H is kept.
class NormalEquations {
 public:
  NormalEquations(const LinearTerms& terms, const Elimination& plan);

  /// Rows [U W] and w, with which the eliminated block leaves: ‖w + U δ_block + W δ_linked‖². There
  /// are fewer than the block has columns when it is not fully determined by what is left.
  struct Rows {
    Eigen::MatrixXd U;
    Eigen::MatrixXd W;
    Eigen::VectorXd w;
    std::vector<int> linked;  ///< blocks, in the order of W's columns
  };
  /// Takes the block out: what remains is the Schur complement. Blocks go in their order.
  const Rows& eliminate(int block);

  int column(int block) const { return plan_.column[static_cast<std::size_t>(block)]; }
  int size(int block) const { return column(block + 1) - column(block); }
  /// The lower half of H.
  const Eigen::MatrixXd& information() const { return H_; }

 private:
  /// A part of a term that has columns.
  struct Piece {
    int block;
    LinearTerms::Jacobian J;
    const double* numbers;
  };
  void add_term(const LinearTerms::Term& term);
  void add_landmark(const std::vector<int>& terms);
  void remove_landmark(double information, double gradient);
  void find_root(int block);
  void find_linked(int block);
  void subtract(const Rows& rows);
  void link(int a, int b) { linked_[index(a, b)] = 1; }
  bool is_linked(int a, int b) const { return linked_[index(a, b)] != 0; }
  std::size_t index(int a, int b) const {
    return static_cast<std::size_t>(a) * plan_.order.size() + static_cast<std::size_t>(b);
  }

  const LinearTerms& terms_;
  const Elimination& plan_;
  Eigen::MatrixXd H_;
  Eigen::VectorXd b_;
  Eigen::VectorXd taken_;  // what landmarks took from the diagonal of H
  Eigen::VectorXd scale_;  // one over the root of the diagonal before anything was taken
  std::vector<char> linked_;
  // Of the landmark at work.
  Eigen::VectorXd h_;
  std::vector<int> seen_from_;
  // Of the block at work.
  std::vector<Piece> pieces_;
  Eigen::MatrixXd root_inverse_;
  Eigen::MatrixXd coupling_;
  Eigen::MatrixXd update_;
  Rows rows_;
};

}  // namespace apvi::vio
