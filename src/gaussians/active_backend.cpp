// SPDX-License-Identifier: BSD-3-Clause
// Selects the backends of this build.
#include <torch/torch.h>
#if APVI_WITH_CUDA
#include <c10/cuda/CUDACachingAllocator.h>
#include <cuda_runtime_api.h>
#endif

#include <algorithm>
#include <array>
#include <string_view>

#include "apvi/core/log.hpp"
#include "gaussians/device.hpp"
#include "gaussians/metrics/loss_backend.hpp"
#include "gaussians/optimizer/adam_backend.hpp"
#include "gaussians/render/raster_backend.hpp"

namespace apvi::gaussians {

const LossBackend& loss_backend(const torch::Device& device) {
  if (device.is_cpu()) return cpu_loss_backend();
#if APVI_WITH_CUDA
  if (device.is_cuda()) return cuda_loss_backend();
#endif
  TORCH_CHECK(false, "this build has no photometric loss for ", device);
}

const RasterBackend& raster_backend(const torch::Device& device) {
  if (device.is_cpu()) return *cpu_raster_backends().front();
#if APVI_WITH_CUDA
  if (device.is_cuda()) return cuda_raster_backend();
#endif
  TORCH_CHECK(false, "this build has no rasterizer for ", device);
}

const AdamBackend& adam_backend(const torch::Device& device) {
  if (device.is_cpu()) return cpu_adam_backend();
#if APVI_WITH_CUDA
  if (device.is_cuda()) return cuda_adam_backend();
#endif
  TORCH_CHECK(false, "this build has no optimizer for ", device);
}

#if APVI_WITH_CUDA
torch::Device active_device() {
  static const bool usable = [] {
    const bool found = torch::cuda::is_available();
    if (!found) log::warning("no usable GPU: mapping runs on the CPU, which is much slower");
    return found;
  }();
  return usable ? torch::kCUDA : torch::kCPU;
}

std::optional<DeviceMemory> device_memory() {
  if (!active_device().is_cuda()) return std::nullopt;
  const auto bytes = c10::cuda::CUDACachingAllocator::getDeviceStats(0).allocated_bytes[0];
  constexpr double kMib = 1024.0 * 1024.0;
  std::size_t free = 0;
  std::size_t total = 0;
  if (cudaMemGetInfo(&free, &total) != cudaSuccess) free = total = 0;
  return DeviceMemory{.allocated_mib = static_cast<double>(bytes.current) / kMib,
                      .peak_mib = static_cast<double>(bytes.peak) / kMib,
                      .free_mib = static_cast<double>(free) / kMib,
                      .total_mib = static_cast<double>(total) / kMib};
}

void reset_peak_memory() {
  if (active_device().is_cuda()) c10::cuda::CUDACachingAllocator::resetPeakStats(0);
}
#else
torch::Device active_device() {
  return torch::kCPU;
}

std::optional<DeviceMemory> device_memory() {
  return std::nullopt;
}

void reset_peak_memory() {}
#endif

bool is_out_of_memory(const c10::Error& error) {
  if (dynamic_cast<const c10::OutOfMemoryError*>(&error) != nullptr) return true;
  const std::string_view message = error.what_without_backtrace();
  constexpr std::array<std::string_view, 3> kPatterns = {"out of memory", "not enough memory",
                                                         "ALLOC_FAILED"};
  return std::any_of(kPatterns.begin(), kPatterns.end(), [message](std::string_view pattern) {
    return message.find(pattern) != std::string_view::npos;
  });
}

}  // namespace apvi::gaussians
