// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/fusion/pose_estimate.hpp"

namespace apvi::fusion {

/// Eq. 7: dipo ⊞ K (vio ⊟ dipo) with K = P (P + H^-1)^-1 = (I + P H)^-1 P H, so that neither
/// matrix is inverted and directions without information stay DIPO's. Takes both for independent,
/// as the paper does.
PoseEstimate fuse_independent(const PoseEstimate& dipo, const SE3& vio, const Matrix6& information);

/// Covariance intersection (Julier and Uhlmann, "A non-divergent estimation algorithm in the
/// presence of unknown correlations", 1997): the weight that makes the result's determinant least.
/// Not overconfident however the two are correlated, if neither is so alone.
struct Intersection {
  PoseEstimate estimate;
  double weight = 1.0;  ///< DIPO's, in [0, 1]
};
Intersection intersect(const PoseEstimate& dipo, const SE3& vio, const Matrix6& information);

}  // namespace apvi::fusion
