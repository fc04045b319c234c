// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace apvi::test {

/// Central differences of `f : R^n -> R^m` at zero, for checking analytic Jacobians. With step h
/// the error is about h² times the third derivative plus rounding / h.
template <typename F>
Eigen::MatrixXd numeric_jacobian(F&& f, Eigen::Index n, double step = 1e-6) {
  Eigen::MatrixXd jacobian;
  for (Eigen::Index i = 0; i < n; ++i) {
    Eigen::VectorXd d = Eigen::VectorXd::Zero(n);
    d(i) = step;
    const Eigen::VectorXd plus = f(d);
    const Eigen::VectorXd minus = f(Eigen::VectorXd(-d));
    if (i == 0) jacobian.resize(plus.size(), n);
    jacobian.col(i) = (plus - minus) / (2.0 * step);
  }
  return jacobian;
}

}  // namespace apvi::test
