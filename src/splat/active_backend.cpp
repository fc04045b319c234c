// SPDX-License-Identifier: BSD-3-Clause
// The one place that knows which backends this build has.
#include <torch/torch.h>
#if APVI_WITH_CUDA
#include <c10/cuda/CUDACachingAllocator.h>
#endif

#include "apvi/core/log.hpp"
#include "apvi/splat/adam_backend.hpp"
#include "apvi/splat/device.hpp"
#include "apvi/splat/loss_backend.hpp"
#include "apvi/splat/medium_backend.hpp"
#include "apvi/splat/raster_backend.hpp"

namespace apvi::splat {

const MediumBackend& medium_backend(const torch::Device& device) {
  if (device.is_cpu()) return cpu_medium_backend();
#if APVI_WITH_CUDA
  if (device.is_cuda()) return cuda_medium_backend();
#endif
  TORCH_CHECK(false, "this build has no backend for ", device);
}

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
  TORCH_CHECK(false, "this build has no optimiser for ", device);
}

#if APVI_WITH_CUDA
torch::Device active_device() {
  static const bool usable = [] {
    const bool found = torch::cuda::is_available();
    if (!found) log::warning("no usable GPU: maps are made on the CPU, which is much slower");
    return found;
  }();
  return usable ? torch::kCUDA : torch::kCPU;
}

std::optional<DeviceMemory> device_memory() {
  if (!active_device().is_cuda()) return std::nullopt;
  const auto bytes = c10::cuda::CUDACachingAllocator::getDeviceStats(0).allocated_bytes[0];
  constexpr double kMib = 1024.0 * 1024.0;
  return DeviceMemory{static_cast<double>(bytes.current) / kMib,
                      static_cast<double>(bytes.peak) / kMib};
}

void forget_peak_memory() {
  if (active_device().is_cuda()) c10::cuda::CUDACachingAllocator::resetPeakStats(0);
}
#else
torch::Device active_device() {
  return torch::kCPU;
}

std::optional<DeviceMemory> device_memory() {
  return std::nullopt;
}

void forget_peak_memory() {}
#endif

}  // namespace apvi::splat
