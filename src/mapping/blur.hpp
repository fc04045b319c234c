// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::mapping {

/// Gaussian blur of planes [n,1,H,W] with `sigma` in pixels and replicated borders.
torch::Tensor blurred(const torch::Tensor& planes, double sigma);

/// Blurred inverse depth [H,W] of a depth map (0: unknown), `sigma` in pixels, over known pixels
/// only.
torch::Tensor blurred_inverse_depth(const torch::Tensor& depth, double sigma);

}  // namespace apvi::mapping
