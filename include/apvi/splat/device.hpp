// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <optional>

namespace apvi::splat {

/// Where tensors are kept: on the GPU when this build was made with APVI_BACKEND=cuda and finds one
/// that LibTorch can use; otherwise in the computer's memory, which such a build warns of once.
torch::Device active_device();

/// Memory of the GPU that tensors hold, LibTorch's unused reserve left out [MiB].
struct DeviceMemory {
  double now_mib = 0.0;
  double peak_mib = 0.0;  ///< since the start, or since `forget_peak_memory`
};
/// Nothing where tensors are in the computer's own memory.
std::optional<DeviceMemory> device_memory();
void forget_peak_memory();

}  // namespace apvi::splat
