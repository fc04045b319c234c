// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <c10/util/Exception.h>
#include <torch/types.h>

#include <optional>

namespace apvi::gaussians {

/// The device for tensors: the GPU when built with APVI_BACKEND=cuda and LibTorch finds one;
/// otherwise the CPU, with one warning in such a build.
torch::Device active_device();

/// Memory of the GPU [MiB].
struct DeviceMemory {
  double allocated_mib = 0.0;  ///< allocated by tensors, without the allocator's unused cache
  double peak_mib = 0.0;       ///< peak since the start or the last `reset_peak_memory`
  double free_mib = 0.0;       ///< not used by any process
  double total_mib = 0.0;
};
/// Nothing when tensors are on the CPU.
std::optional<DeviceMemory> device_memory();
void reset_peak_memory();

/// Whether the error is an out-of-memory error of LibTorch, CUDA or the CPU rasterizer.
bool is_out_of_memory(const c10::Error& error);

}  // namespace apvi::gaussians
