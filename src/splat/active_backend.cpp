// SPDX-License-Identifier: BSD-3-Clause
// The one place that knows which backends this build has.
#include <torch/torch.h>

#include "apvi/splat/adam_backend.hpp"
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

torch::Device active_device() {
  return APVI_WITH_CUDA ? torch::kCUDA : torch::kCPU;
}

}  // namespace apvi::splat
