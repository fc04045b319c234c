// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Householder>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "vio/marginalization/elimination.hpp"

namespace apvi::vio {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Column norm relative to that before elimination, below which a direction counts as unobservable;
// rounding leaves about 1e-15.
constexpr double kRankTolerance = 1e-13;

// Minimum column norm of an observed landmark.
constexpr double kMinLandmarkLength = 1e-30;

/// Rows [J | r] stacked from terms.
class Stack {
 public:
  explicit Stack(Index columns) : rows_(0, columns + 1) {}

  MatrixXd::RowsBlockXpr append(Index rows) {
    if (used_ + rows > rows_.rows()) {
      rows_.conservativeResize(std::max(2 * rows_.rows(), used_ + rows), Eigen::NoChange);
    }
    used_ += rows;
    auto added = rows_.middleRows(used_ - rows, rows);
    added.setZero();
    return added;
  }
  auto rows() const { return rows_.topRows(used_); }

 private:
  MatrixXd rows_;
  Index used_ = 0;
};

template <typename Rows>
void write_term(const LinearTerms& terms, const LinearTerms::Term& term, const Elimination& plan,
                Rows&& rows) {
  for (const auto& part : terms.parts(term)) {
    const int block = plan.position[static_cast<std::size_t>(part.variable)];
    if (block < 0) continue;
    const auto J = terms.jacobian(term, part);
    rows.middleCols(plan.column[static_cast<std::size_t>(block)], J.cols()) += J;
  }
  rows.col(rows.cols() - 1) = terms.residual(term);
}

// The Jacobian of a term by its landmark.
auto landmark_column(const LinearTerms& terms, const LinearTerms::Term& term,
                     const Elimination& plan) {
  const auto own = std::ranges::find_if(terms.parts(term), [&](const auto& part) {
    return plan.position[static_cast<std::size_t>(part.variable)] == Elimination::kLandmark;
  });
  return Eigen::Map<const VectorXd>(terms.numbers(own->jacobian), term.rows);
}

/// Terms of a landmark with it eliminated: a Householder reflection reduces its column to one row,
/// which is dropped.
void append_landmark(const LinearTerms& terms, const Elimination& plan,
                     const std::vector<int>& list, Stack& stack) {
  Index count = 0;
  for (const int t : list) count += terms.terms()[static_cast<std::size_t>(t)].rows;
  MatrixXd rows = MatrixXd::Zero(count, plan.columns() + 1);
  VectorXd own(count);
  Index row = 0;
  for (const int t : list) {
    const LinearTerms::Term& term = terms.terms()[static_cast<std::size_t>(t)];
    write_term(terms, term, plan, rows.middleRows(row, term.rows));
    own.segment(row, term.rows) = landmark_column(terms, term, plan);
    row += term.rows;
  }
  double tau = 0.0;
  double length = 0.0;
  VectorXd essential(count - 1);
  own.makeHouseholder(essential, tau, length);
  if (std::abs(length) < kMinLandmarkLength) {
    stack.append(count) = rows;
    return;
  }
  VectorXd workspace(rows.cols());
  rows.applyHouseholderOnTheLeft(essential, tau, workspace.data());
  stack.append(count - 1) = rows.bottomRows(count - 1);
}

// Non-zero columns, and always the last column (residuals).
std::vector<Index> columns_in_use(const MatrixXd& rows) {
  std::vector<Index> used;
  for (Index c = 0; c + 1 < rows.cols(); ++c) {
    if (rows.col(c).cwiseAbs().maxCoeff() > 0.0) used.push_back(c);
  }
  used.push_back(rows.cols() - 1);
  return used;
}

/// Compresses to as many rows as columns in use, with the same JᵀJ and Jᵀr.
MatrixXd compress(const MatrixXd& rows) {
  if (rows.rows() == 0) return rows;
  const std::vector<Index> used = columns_in_use(rows);
  const auto n = static_cast<Index>(used.size());
  if (rows.rows() <= n) return rows;
  const Eigen::HouseholderQR<MatrixXd> qr(MatrixXd(rows(Eigen::all, used)));
  MatrixXd result = MatrixXd::Zero(n, rows.cols());
  result(Eigen::all, used) =
      MatrixXd(qr.matrixQR().topRows(n).template triangularView<Eigen::Upper>());
  return result;
}

MatrixXd stack_terms(const LinearTerms& terms, const Elimination& plan) {
  Stack seen(plan.columns());
  for (const auto& list : plan.terms_of_landmark) append_landmark(terms, plan, list, seen);
  const MatrixXd by_camera = compress(seen.rows());
  Stack all(plan.columns());
  all.append(by_camera.rows()) = by_camera;
  for (const int t : plan.other_terms) {
    const LinearTerms::Term& term = terms.terms()[static_cast<std::size_t>(t)];
    write_term(terms, term, plan, all.append(term.rows));
  }
  return all.rows();
}

/// Rows that remain after projecting out the first `eliminated` columns.
MatrixXd marginalize_columns(const MatrixXd& rows, Index eliminated) {
  if (eliminated == 0) return rows;
  const VectorXd length = rows.leftCols(eliminated).colwise().norm();
  const VectorXd scale = length.unaryExpr([](double l) { return l > 0.0 ? 1.0 / l : 0.0; });
  Eigen::ColPivHouseholderQR<MatrixXd> qr;
  qr.setThreshold(kRankTolerance);
  qr.compute(rows.leftCols(eliminated) * scale.asDiagonal());
  MatrixXd rest = rows.rightCols(rows.cols() - eliminated);
  rest.applyOnTheLeft(qr.householderQ().adjoint());
  return rest.bottomRows(rest.rows() - qr.rank());
}

}  // namespace

SquareRoot eliminate_by_qr(const LinearTerms& terms, const Elimination& plan) {
  const MatrixXd left = marginalize_columns(stack_terms(terms, plan), plan.eliminated_columns());
  const MatrixXd upper = compress(left);
  const Index n = upper.cols() - 1;
  // The last row holds a constant cost only.
  const Index rows = std::min(upper.rows(), n);
  return {upper.topLeftCorner(rows, n), upper.col(n).head(rows)};
}

}  // namespace apvi::vio
