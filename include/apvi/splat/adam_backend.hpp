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
};

/// cpu_fallback/adam.cpp; float32 and float64, the same bits with any number of threads.
const AdamBackend& cpu_adam_backend();

/// The backend for tensors on `device`. Throws c10::Error for one this build has no backend for.
const AdamBackend& adam_backend(const torch::Device& device);

}  // namespace apvi::splat
