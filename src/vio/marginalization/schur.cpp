// SPDX-License-Identifier: BSD-3-Clause
#include "vio/marginalization/elimination.hpp"
#include "vio/window/normal_equations.hpp"

namespace apvi::vio {

using Eigen::Index;

// The elimination rows of the remaining blocks form the square root.
SquareRoot eliminate_by_schur(const LinearTerms& terms, const Elimination& plan) {
  NormalEquations equations(terms, plan);
  for (int block = 0; block < plan.eliminated; ++block) equations.eliminate(block);
  const Index first = plan.eliminated_columns();
  const Index n = plan.columns() - first;
  SquareRoot result{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n)};
  Index row = 0;
  for (int block = plan.eliminated; block < static_cast<int>(plan.order.size()); ++block) {
    const NormalEquations::Rows& rows = equations.eliminate(block);
    const Index rank = rows.U.rows();
    result.J.block(row, equations.column(block) - first, rank, rows.U.cols()) = rows.U;
    result.r.segment(row, rank) = rows.w;
    Index c = 0;
    for (const int a : rows.linked) {
      const Index size = equations.size(a);
      result.J.block(row, equations.column(a) - first, rank, size) = rows.W.middleCols(c, size);
      c += size;
    }
    row += rank;
  }
  result.J.conservativeResize(row, Eigen::NoChange);
  result.r.conservativeResize(row);
  return result;
}

Eigen::MatrixXd information_by_schur(const LinearTerms& terms, const Elimination& plan) {
  NormalEquations equations(terms, plan);
  for (int block = 0; block < plan.eliminated; ++block) equations.eliminate(block);
  const Index n = plan.columns() - plan.eliminated_columns();
  return equations.information().bottomRightCorner(n, n).selfadjointView<Eigen::Lower>();
}

}  // namespace apvi::vio
