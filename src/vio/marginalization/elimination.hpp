// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "vio/marginalization/marginalization.hpp"

namespace apvi::vio {

/// Elimination order: which blocks are eliminated, in what order, and the columns of the others.
struct Elimination {
  static constexpr int kLandmark = -1;  ///< as a position: eliminated first, with its own terms
  static constexpr int kConstant = -2;

  std::vector<int> position;  ///< per variable: index in `order`, or one of the above
  std::vector<int> order;     ///< variables with columns: eliminated ones first, then the remaining
  std::vector<int> column;    ///< per entry of `order`: its first column; plus the end
  int eliminated = 0;         ///< number of eliminated entries of `order`

  std::vector<std::vector<int>> terms_of_landmark;
  std::vector<int> other_terms;

  int columns() const { return column.back(); }
  int eliminated_columns() const { return column[static_cast<std::size_t>(eliminated)]; }
};

/// `eliminate`: flag per variable.
Elimination plan_elimination(const LinearTerms& terms, const std::vector<char>& eliminate);

/// ‖r + J δ‖² by the remaining columns.
struct SquareRoot {
  Eigen::MatrixXd J;
  Eigen::VectorXd r;
};
SquareRoot eliminate_by_schur(const LinearTerms& terms, const Elimination& plan);
SquareRoot eliminate_by_qr(const LinearTerms& terms, const Elimination& plan);
/// JᵀJ of the result of eliminate_by_schur.
Eigen::MatrixXd information_by_schur(const LinearTerms& terms, const Elimination& plan);

}  // namespace apvi::vio
