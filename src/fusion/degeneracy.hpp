// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "fusion/pose_estimate.hpp"

namespace apvi::fusion {

/// Eigenvalues of the two diagonal blocks of an information matrix, ascending (the paper's Eq. 6).
struct Eigenvalues {
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();  ///< [1/rad²]
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< [1/m²]
};

/// Lower bounds for the eigenvalues; 0: not tested.
struct EigenThresholds {
  double rotation = 0.0;  ///< [1/rad²]
  double position = 0.0;  ///< [1/m²]
};

/// Eq. 6. Small negative eigenvalues due to rounding are returned unchanged.
Eigenvalues block_eigenvalues(const Matrix6& information);

/// Divided by the number of inliers, so that one threshold suits feature-rich and feature-poor
/// scenes; unchanged if `inliers` < 1.
Eigenvalues per_inlier(const Eigenvalues& eigenvalues, int inliers);

/// The directions of the tangent space in which a measurement may update the state.
struct WellConditioned {
  Matrix6 projection = Matrix6::Identity();  ///< V_f^-1 V_u, block diagonal
  Eigen::Matrix<double, 6, Eigen::Dynamic> basis = Matrix6::Identity();  ///< orthonormal columns
  int directions() const { return static_cast<int>(basis.cols()); }
};

/// Solution remapping: Δx = V_f^-1 V_u Δx_u with the eigenvectors as rows of V_f and those below
/// their threshold zeroed in V_u (Zhang, Kaess, Singh, "On degeneracy of optimization-based state
/// estimation problems", ICRA 2016). The rotation and the position block are remapped separately,
/// as their eigenvalues have different units.
WellConditioned well_conditioned(const Matrix6& information, const EigenThresholds& thresholds);

}  // namespace apvi::fusion
