// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "apvi/splat/gaussians.hpp"

namespace apvi::splat {

/// Motions of the world with a change of size: x -> scale R x + t. What a closed loop does to the
/// parts of a map that keyframes made, M of them at once.
struct Similarities {
  torch::Tensor scales;  ///< [M] float64 on the CPU
  torch::Tensor R;       ///< [M,3,3] float64 on the CPU, orthonormal
  torch::Tensor t;       ///< [M,3] float64 on the CPU [m]
};

/// Those of rigid motions [M,4,4] float64.
Similarities rigid_motions(const torch::Tensor& motions);

/// The Gaussians moved, each by the motion that `which` [N] (int64) says, or all by the first:
/// means, quaternions, log-scales (by + log scale) and the coefficients of the spherical harmonics,
/// so that a camera moved along sees what it saw. Throws c10::Error for a scale that is not
/// positive or an R that is no rotation.
Gaussians transformed(const Gaussians& gaussians, const Similarities& similarities,
                      const torch::Tensor& which = {});

/// [M,K,K] float64, K = sh_rest_count(degree): turn coefficients beyond the constant one into those
/// of the same colours seen from directions rotated by R [M,3,3].
torch::Tensor sh_rotations(int degree, const torch::Tensor& R);

}  // namespace apvi::splat
