// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "gaussians/model/gaussians.hpp"

namespace apvi::gaussians {

/// A batch of M similarity transforms of the world: x -> scale R x + t, e.g. loop closure
/// corrections of the keyframes that parts of a map are anchored to.
struct SimilarityTransforms {
  torch::Tensor scales;  ///< [M] float64 on the CPU
  torch::Tensor R;       ///< [M,3,3] float64 on the CPU, orthonormal
  torch::Tensor t;       ///< [M,3] float64 on the CPU [m]
};

/// Similarity transforms (scale 1) from rigid transforms [M,4,4] float64.
SimilarityTransforms rigid_transforms(const torch::Tensor& motions);

/// A change of the unit of length about a point that stays: p' = center + scale (p - center).
struct ScaleChange {
  double scale = 1.0;    ///< new units per old unit
  torch::Tensor center;  ///< [3] float64 on the CPU
};
SimilarityTransforms scaling(const ScaleChange& change);

/// Transforms the Gaussians, each by transform number `which` [N] (int64), or all by the first:
/// means, quaternions, log scales (plus log scale) and the spherical harmonics, so that the view of
/// a camera moved along is unchanged. Throws c10::Error for a non-positive scale or an R that is
/// not a rotation.
Gaussians transformed(const Gaussians& gaussians, const SimilarityTransforms& similarities,
                      const torch::Tensor& which = {});

/// [M,K,K] float64, K = sh_rest_count(degree): rotation matrices of the SH coefficients beyond the
/// constant one, for rotations R [M,3,3].
torch::Tensor sh_rotations(int degree, const torch::Tensor& R);

}  // namespace apvi::gaussians
