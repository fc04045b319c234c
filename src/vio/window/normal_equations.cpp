// SPDX-License-Identifier: BSD-3-Clause
#include "vio/window/normal_equations.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace apvi::vio {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Relative to the information before any elimination; a direction with less counts as unobservable.
// Rounding leaves about 1e-15 there.
constexpr double kRankTolerance = 1e-13;
// A sum of squares, so accurate even if tiny.
constexpr double kMinLandmarkInformation = 1e-60;

// Jacobian of a camera observation by a pose, 2x6; the seventh column is padding.
using CameraJacobian =
    Eigen::Map<const Eigen::Matrix<double, 2, 6, Eigen::RowMajor>, 0, Eigen::OuterStride<7>>;
using Block66 = Eigen::Map<Eigen::Matrix<double, 6, 6>, 0, Eigen::OuterStride<>>;

}  // namespace

NormalEquations::NormalEquations(const LinearTerms& terms, const Elimination& plan)
    : terms_(terms),
      plan_(plan),
      H_(MatrixXd::Zero(plan.columns(), plan.columns())),
      b_(VectorXd::Zero(plan.columns())),
      taken_(VectorXd::Zero(plan.columns())),
      linked_(plan.order.size() * plan.order.size()),
      h_(VectorXd::Zero(plan.columns())) {
  for (const int t : plan.other_terms) add_term(terms.terms()[static_cast<std::size_t>(t)]);
  for (const auto& list : plan.terms_of_landmark) add_landmark(list);
  scale_ = (H_.diagonal() + taken_).unaryExpr([](double d) {
    return d > 0.0 ? 1.0 / std::sqrt(d) : 0.0;
  });
}

void NormalEquations::add_term(const LinearTerms::Term& term) {
  pieces_.clear();
  for (const auto& part : terms_.parts(term)) {
    const int block = plan_.position[static_cast<std::size_t>(part.variable)];
    if (block < 0) continue;
    pieces_.push_back({block, terms_.jacobian(term, part), terms_.numbers(part.jacobian)});
  }
  const auto r = terms_.residual(term);
  for (const Piece& a : pieces_) {
    b_.segment(column(a.block), a.J.cols()).noalias() += a.J.transpose().lazyProduct(r);
    for (const Piece& b : pieces_) {
      if (a.block < b.block) continue;
      link(a.block, b.block);
      double* const corner = &H_(column(a.block), column(b.block));
      if (term.rows == 2 && a.J.outerStride() == 7 && b.J.outerStride() == 7) {
        Block66(corner, Eigen::OuterStride<>(H_.rows())) +=
            CameraJacobian(a.numbers).transpose().lazyProduct(CameraJacobian(b.numbers));
      } else {
        H_.block(column(a.block), column(b.block), a.J.cols(), b.J.cols()).noalias() +=
            a.J.transpose() * b.J;
      }
    }
  }
}

void NormalEquations::add_landmark(const std::vector<int>& terms) {
  double information = 0.0;
  double gradient = 0.0;
  seen_from_.clear();
  for (const int t : terms) {
    const LinearTerms::Term& term = terms_.terms()[static_cast<std::size_t>(t)];
    const auto r = terms_.residual(term);
    const auto parts = terms_.parts(term);
    const auto own = std::ranges::find_if(parts, [&](const auto& part) {
      return plan_.position[static_cast<std::size_t>(part.variable)] == Elimination::kLandmark;
    });
    const Eigen::Map<const VectorXd> j(terms_.numbers(own->jacobian), term.rows);
    add_term(term);
    information += j.squaredNorm();
    gradient += j.dot(r);
    for (const Piece& piece : pieces_) {
      h_.segment(column(piece.block), piece.J.cols()).noalias() +=
          piece.J.transpose().lazyProduct(j);
      seen_from_.push_back(piece.block);
    }
  }
  std::ranges::sort(seen_from_);
  seen_from_.erase(std::unique(seen_from_.begin(), seen_from_.end()), seen_from_.end());
  remove_landmark(information, gradient);
  for (const int block : seen_from_) h_.segment(column(block), size(block)).setZero();
}

void NormalEquations::remove_landmark(double information, double gradient) {
  if (information < kMinLandmarkInformation) return;
  const double share = 1.0 / information;
  for (const int b : seen_from_) {
    const Index cb = column(b);
    const VectorXd::SegmentReturnType hb = h_.segment(cb, size(b));
    b_.segment(cb, size(b)) -= share * gradient * hb;
    taken_.segment(cb, size(b)) += share * hb.cwiseAbs2();
    for (const int a : seen_from_) {
      if (a < b) continue;
      link(a, b);
      const Index ca = column(a);
      if (size(a) == 6 && size(b) == 6) {
        const Eigen::Matrix<double, 6, 1> scaled = share * h_.segment<6>(cb);
        Block66(&H_(ca, cb), Eigen::OuterStride<>(H_.rows())) -=
            h_.segment<6>(ca).lazyProduct(scaled.transpose());
      } else {
        H_.block(ca, cb, size(a), size(b)).noalias() -=
            share * h_.segment(ca, size(a)).lazyProduct(hb.transpose());
      }
    }
  }
}

// Computes U with UᵀU = H of the block, and root_inverse_ with U root_inverse_ = 1.
void NormalEquations::find_root(int block) {
  const Index c = column(block);
  const Index n = size(block);
  const VectorXd scale = scale_.segment(c, n);
  const MatrixXd full = H_.block(c, c, n, n).selfadjointView<Eigen::Lower>();
  const MatrixXd scaled = scale.asDiagonal() * full * scale.asDiagonal();
  const Eigen::LLT<MatrixXd> llt(scaled);
  const auto root = llt.matrixLLT().diagonal();
  if (llt.info() == Eigen::Success && root.cwiseAbs2().minCoeff() > kRankTolerance) {
    rows_.U = MatrixXd(llt.matrixU()) * scale.cwiseInverse().asDiagonal();
    root_inverse_ = scale.asDiagonal() * MatrixXd(llt.matrixU().solve(MatrixXd::Identity(n, n)));
    return;
  }
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(scaled);
  const Index zero = (eigen.eigenvalues().array() <= kRankTolerance).count();
  const VectorXd values = eigen.eigenvalues().tail(n - zero).cwiseSqrt();
  const MatrixXd vectors = eigen.eigenvectors().rightCols(n - zero);
  const VectorXd unscale = scale.unaryExpr([](double s) { return s > 0.0 ? 1.0 / s : 0.0; });
  rows_.U = values.asDiagonal() * vectors.transpose() * unscale.asDiagonal();
  root_inverse_ = scale.asDiagonal() * vectors * values.cwiseInverse().asDiagonal();
}

// Collects the later blocks coupled to this one, and their blocks of H.
void NormalEquations::find_linked(int block) {
  rows_.linked.clear();
  Index n = 0;
  for (int a = block + 1; a < static_cast<int>(plan_.order.size()); ++a) {
    if (!is_linked(a, block)) continue;
    rows_.linked.push_back(a);
    n += size(a);
  }
  coupling_.resize(n, size(block));
  Index row = 0;
  for (const int a : rows_.linked) {
    coupling_.middleRows(row, size(a)) = H_.block(column(a), column(block), size(a), size(block));
    row += size(a);
  }
}

void NormalEquations::subtract(const Rows& rows) {
  const Index n = rows.W.cols();
  update_.resize(n, n);
  update_.noalias() = rows.W.transpose() * rows.W;
  Index cb = 0;
  for (const int b : rows.linked) {
    b_.segment(column(b), size(b)).noalias() -= rows.W.middleCols(cb, size(b)).transpose() * rows.w;
    Index ca = 0;
    for (const int a : rows.linked) {
      if (a >= b) {
        link(a, b);
        H_.block(column(a), column(b), size(a), size(b)) -= update_.block(ca, cb, size(a), size(b));
      }
      ca += size(a);
    }
    cb += size(b);
  }
}

const NormalEquations::Rows& NormalEquations::eliminate(int block) {
  find_root(block);
  find_linked(block);
  rows_.W.noalias() = root_inverse_.transpose() * coupling_.transpose();
  rows_.w.noalias() = root_inverse_.transpose() * b_.segment(column(block), size(block));
  subtract(rows_);
  return rows_;
}

}  // namespace apvi::vio
