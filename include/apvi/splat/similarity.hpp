// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "apvi/splat/gaussians.hpp"

namespace apvi::splat {

/// A motion of the world with a change of size: x -> scale R x + t. What a loop closure does to the
/// part of a map that a keyframe made.
struct Similarity {
  double scale = 1.0;
  torch::Tensor R;  ///< [3,3] float64 on the CPU, orthonormal
  torch::Tensor t;  ///< [3] float64 on the CPU [m]
};

/// The Gaussians moved: means, quaternions, log-scales (by + log scale) and the coefficients of the
/// spherical harmonics, so that a camera moved along sees what it saw. Throws c10::Error for a
/// scale that is not positive or an R that is no rotation.
Gaussians transformed(const Gaussians& gaussians, const Similarity& similarity);

/// [K,K] float64, K = sh_rest_count(degree): turns coefficients beyond the constant one into those
/// of the same colours seen from directions rotated by R [3,3].
torch::Tensor sh_rotation(int degree, const torch::Tensor& R);

}  // namespace apvi::splat
