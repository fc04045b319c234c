// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <vector>

#include "gaussians/optimizer/adam.hpp"

namespace apvi::gaussians {

/// Interface of the CPU and CUDA optimizers: both update the same tensors.
class AdamBackend {
 public:
  AdamBackend() = default;
  AdamBackend(const AdamBackend&) = delete;
  AdamBackend& operator=(const AdamBackend&) = delete;
  virtual ~AdamBackend() = default;

  virtual std::string_view name() const = 0;
  /// As `adam_step`, with validated groups.
  virtual void step(const std::vector<AdamGroup>& groups, std::int64_t steps,
                    const AdamOptions& options, const torch::Tensor& visible) const = 0;
  /// As `adam_step_sparse`. Throws c10::Error where the backend does not support sparse gradients.
  virtual void step_sparse(const std::vector<AdamGroup>& groups, const SparseGradient& gradient,
                           std::int64_t steps, const AdamOptions& options, bool visible_only) const;
};

/// cpu_fallback/optimizer/adam.cpp; float32 and float64, bitwise identical for any number of
/// threads.
const AdamBackend& cpu_adam_backend();

/// kernels/optimizer/cuda_adam.cpp, in builds with APVI_BACKEND=cuda; float32.
const AdamBackend& cuda_adam_backend();

/// The backend for tensors on `device`. Throws c10::Error if this build has none.
const AdamBackend& adam_backend(const torch::Device& device);

}  // namespace apvi::gaussians
