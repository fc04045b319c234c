// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/torch.h>

#include <vector>

namespace apvi::test {

/// The CPU, and the GPU if built with CUDA and available.
inline std::vector<torch::Device> available_devices() {
  std::vector<torch::Device> devices = {torch::kCPU};
  if (APVI_WITH_CUDA && torch::cuda::is_available()) devices.emplace_back(torch::kCUDA);
  return devices;
}

}  // namespace apvi::test
