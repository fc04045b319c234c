// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <c10/util/Exception.h>
#include <torch/types.h>

#include <new>

/// A memory pool. A rasterizer pass takes about 60 MB for 100,000 Gaussians and frees it after the
/// backward pass; the system would have to clear every page again each time, which costs as much as
/// the projection.
namespace apvi::gaussians {

/// An uninitialized CPU tensor, in pooled memory if a block fits. The pool holds at most 1 GiB, and
/// no block for longer than a few passes. Throws c10::OutOfMemoryError.
torch::Tensor pooled_empty(at::IntArrayRef sizes, const torch::TensorOptions& options);

/// Runs f and converts std::bad_alloc to c10::OutOfMemoryError.
template <typename F>
auto convert_bad_alloc(F&& f) {
  try {
    return f();
  } catch (const std::bad_alloc&) {
    TORCH_CHECK_WITH(OutOfMemoryError, false, "render: insufficient memory for so many Gaussians");
  }
}

}  // namespace apvi::gaussians
