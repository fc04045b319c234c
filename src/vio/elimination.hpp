// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "apvi/vio/marginalization.hpp"

namespace apvi::vio {

/// Which blocks go, in what order, and the columns of the others.
struct Elimination {
  static constexpr int kLandmark = -1;  ///< as a column: goes first, alone with its terms
  static constexpr int kConstant = -2;

  std::vector<int> position;  ///< per variable: index into `order`, or one of the above
  std::vector<int> order;     ///< variables with columns: those that go, then those that stay
  std::vector<int> column;    ///< per entry of `order`: its first column; one more for the end
  int going = 0;              ///< entries of `order` that go

  std::vector<std::vector<int>> terms_of_landmark;
  std::vector<int> other_terms;

  int columns() const { return column.back(); }
  int going_columns() const { return column[static_cast<std::size_t>(going)]; }
};

/// `goes`: per variable.
Elimination plan_elimination(const LinearTerms& terms, const std::vector<char>& goes);

/// ‖r + J δ‖² by the columns that stay.
struct SquareRoot {
  Eigen::MatrixXd J;
  Eigen::VectorXd r;
};
SquareRoot eliminate_by_schur(const LinearTerms& terms, const Elimination& plan);
SquareRoot eliminate_by_qr(const LinearTerms& terms, const Elimination& plan);
/// JᵀJ of the first.
Eigen::MatrixXd information_by_schur(const LinearTerms& terms, const Elimination& plan);

}  // namespace apvi::vio
