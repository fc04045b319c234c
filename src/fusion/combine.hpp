// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "fusion/pose_estimate.hpp"

namespace apvi::fusion {

/// Eq. 7: dipo ⊞ K (vio ⊟ dipo) with K = P (P + H^-1)^-1 = (I + P H)^-1 P H, so that neither matrix
/// is inverted and directions without information remain those of DIPO. Assumes independent
/// estimates, as the paper does.
PoseEstimate fuse_independent(const PoseEstimate& dipo, const SE3& vio, const Matrix6& information);

/// Covariance intersection (Julier and Uhlmann, "A non-divergent estimation algorithm in the
/// presence of unknown correlations", 1997), with the weight that minimizes the determinant of the
/// result. Consistent for any correlation if both inputs are consistent.
struct CovarianceIntersection {
  PoseEstimate estimate;
  double weight = 1.0;  ///< weight of DIPO, in [0, 1]
};
CovarianceIntersection intersect_covariances(const PoseEstimate& dipo, const SE3& vio,
                                             const Matrix6& information);

}  // namespace apvi::fusion
