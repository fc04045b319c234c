// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::gaussians {

/// Rotation matrices [N,3,3] of quaternions w x y z [N,4] of any nonzero norm.
torch::Tensor rotations_of(const torch::Tensor& quaternions);

/// Unit quaternions [N,4] w x y z of rotation matrices [N,3,3], by the dominant eigenvectors of
/// Bar-Itzhack's matrices ("New method for extracting the quaternion from a rotation matrix",
/// 2000), which need no case distinction. The largest component is positive.
torch::Tensor quaternions_of(const torch::Tensor& R);

/// Products of quaternions w x y z, [N,4] each.
torch::Tensor quaternion_products(const torch::Tensor& a, const torch::Tensor& b);

}  // namespace apvi::gaussians
