// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <vector>

#include "apvi/splat/adam.hpp"

namespace apvi::splat {

/// The seam between CPU and CUDA: both change the same tensors.
class AdamBackend {
 public:
  AdamBackend() = default;
  AdamBackend(const AdamBackend&) = delete;
  AdamBackend& operator=(const AdamBackend&) = delete;
  virtual ~AdamBackend() = default;

  virtual std::string_view name() const = 0;
  /// As `adam_step`, of groups that were checked.
  virtual void step(const std::vector<AdamGroup>& groups, std::int64_t steps,
                    const AdamOptions& options, const torch::Tensor& visible) const = 0;
  /// As `adam_step_rows`. Throws c10::Error where the backend's rasterizer has no rows.
  virtual void step_rows(const std::vector<AdamGroup>& groups, const GaussianRows& rows,
                         std::int64_t steps, const AdamOptions& options, bool visible_only) const;
};

/// cpu_fallback/adam.cpp; float32 and float64, the same bits with any number of threads.
const AdamBackend& cpu_adam_backend();

/// kernels/cuda_backend.cpp, in builds with APVI_BACKEND=cuda; float32.
const AdamBackend& cuda_adam_backend();

/// The backend for tensors on `device`. Throws c10::Error for one this build has no backend for.
const AdamBackend& adam_backend(const torch::Device& device);

}  // namespace apvi::splat
