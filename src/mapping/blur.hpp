// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::mapping {

/// Planes [n,1,H,W] blurred by a Gaussian of `sigma` pixels; what is at the edges goes on outside.
torch::Tensor blurred(const torch::Tensor& planes, double sigma);

/// Inverse depth [H,W] of a depth map (0: unknown) blurred by `sigma` pixels, from what is known.
torch::Tensor blurred_inverse_depth(const torch::Tensor& depth, double sigma);

}  // namespace apvi::mapping
