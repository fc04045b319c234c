// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/degeneracy.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>

namespace apvi::fusion {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Solver = Eigen::SelfAdjointEigenSolver<Matrix3d>;

Matrix3d block(const Matrix6& information, int at) {
  const Matrix3d m = information.block<3, 3>(at, at);
  return 0.5 * (m + m.transpose());
}

}  // namespace

Eigenvalues block_eigenvalues(const Matrix6& information) {
  return {Solver(block(information, 0), Eigen::EigenvaluesOnly).eigenvalues(),
          Solver(block(information, 3), Eigen::EigenvaluesOnly).eigenvalues()};
}

Eigenvalues per_inlier(const Eigenvalues& eigenvalues, int inliers) {
  const double n = std::max(1, inliers);
  return {eigenvalues.rotation / n, eigenvalues.position / n};
}

WellConditioned well_conditioned(const Matrix6& information, const EigenThresholds& thresholds) {
  WellConditioned result;
  result.projection.setZero();
  Matrix6 kept = Matrix6::Zero();
  int count = 0;
  for (const int at : {0, 3}) {
    const double threshold = at == 0 ? thresholds.rotation : thresholds.position;
    const Solver solver(block(information, at));
    for (int i = 0; i < 3; ++i) {
      if (solver.eigenvalues()(i) < threshold) continue;
      // Eigenvectors are columns here, rows in the paper.
      const Vector3d direction = solver.eigenvectors().col(i);
      result.projection.block<3, 3>(at, at) += direction * direction.transpose();
      kept.block<3, 1>(at, count++) = direction;
    }
  }
  result.basis = kept.leftCols(count);
  return result;
}

}  // namespace apvi::fusion
