// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

/// A memory pool. A rasterizer pass takes about 60 MB for 100,000 Gaussians and frees it after the
/// backward pass; the system would have to clear every page again each time, which costs as much as
/// the projection.
namespace apvi::gaussians {

/// An uninitialized CPU tensor, in pooled memory if a block fits. The pool holds at most 1 GiB, and
/// no block for longer than a few passes.
torch::Tensor pooled_empty(at::IntArrayRef sizes, const torch::TensorOptions& options);

}  // namespace apvi::gaussians
