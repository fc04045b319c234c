// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "vio/marginalization/elimination.hpp"

namespace apvi::vio {

/// Block normal equations H = JᵀJ, b = Jᵀr with tracking of the non-zero blocks, and elimination of
/// blocks. Only the lower half of H is stored.
class NormalEquations {
 public:
  NormalEquations(const LinearTerms& terms, const Elimination& plan);

  /// Rows [U W] and w of an eliminated block: ‖w + U δ_block + W δ_linked‖². Fewer rows than
  /// columns of the block if it is not fully determined.
  struct Rows {
    Eigen::MatrixXd U;
    Eigen::MatrixXd W;
    Eigen::VectorXd w;
    std::vector<int> linked;  ///< coupled blocks, in the order of W's columns
  };
  /// Eliminates a block; the remainder is the Schur complement. Blocks must be eliminated in order.
  const Rows& eliminate(int block);

  int column(int block) const { return plan_.column[static_cast<std::size_t>(block)]; }
  int size(int block) const { return column(block + 1) - column(block); }
  /// The lower half of H.
  const Eigen::MatrixXd& information() const { return H_; }

 private:
  /// A part of a term with columns in H.
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
  Eigen::VectorXd taken_;  // reduction of the diagonal of H by landmarks
  Eigen::VectorXd scale_;  // inverse square root of the diagonal before elimination
  std::vector<char> linked_;
  // Scratch for the current landmark.
  Eigen::VectorXd h_;
  std::vector<int> seen_from_;
  // Scratch for the current block.
  std::vector<Piece> pieces_;
  Eigen::MatrixXd root_inverse_;
  Eigen::MatrixXd coupling_;
  Eigen::MatrixXd update_;
  Rows rows_;
};

}  // namespace apvi::vio
