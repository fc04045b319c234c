// SPDX-License-Identifier: BSD-3-Clause
// Selects among the medium backends of this build.
#include <torch/torch.h>

#include "medium/medium_backend.hpp"

namespace apvi::medium {

const MediumBackend& medium_backend(const torch::Device& device) {
  if (device.is_cpu()) return cpu_medium_backend();
#if APVI_WITH_CUDA
  if (device.is_cuda()) return cuda_medium_backend();
#endif
  TORCH_CHECK(false, "this build has no backend for ", device);
}

}  // namespace apvi::medium
