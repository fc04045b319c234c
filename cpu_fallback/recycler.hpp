// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

/// Memory that comes back. A pass of the rasterizer takes some 60 MB for 100,000 Gaussians and
/// gives them back when its gradients are used up; from the system every page of it would have to
/// be cleared again each time, which costs as much as the projection.
namespace apvi::splat {

/// A tensor on the CPU with undefined contents, in memory that went through here before if any
/// fits. At most 1 GiB waits to be used again, and no block for longer than a few passes.
torch::Tensor recycled_empty(at::IntArrayRef sizes, const torch::TensorOptions& options);

}  // namespace apvi::splat
