// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <c10/util/Exception.h>
#include <torch/types.h>

#include <optional>

namespace apvi::splat {

/// Where tensors are kept: on the GPU when this build was made with APVI_BACKEND=cuda and finds one
/// that LibTorch can use; otherwise in the computer's memory, which such a build warns of once.
torch::Device active_device();

/// Memory of the GPU [MiB].
struct DeviceMemory {
  double now_mib = 0.0;   ///< that tensors hold, LibTorch's unused reserve left out
  double peak_mib = 0.0;  ///< the same since the start, or since `forget_peak_memory`
  double free_mib = 0.0;  ///< that no program holds
  double total_mib = 0.0;
};
/// Nothing where tensors are in the computer's own memory.
std::optional<DeviceMemory> device_memory();
void forget_peak_memory();

/// Whether LibTorch, or CUDA beneath it, says that memory has ended.
bool is_out_of_memory(const c10::Error& error);

}  // namespace apvi::splat
