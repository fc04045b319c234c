// SPDX-License-Identifier: BSD-3-Clause
// The one place that knows which backends of depth estimation this build has.
#include "apvi/mapping/depth_backend.hpp"

#include <torch/torch.h>

namespace apvi::mapping {

const DepthBackend& depth_backend(const torch::Device& device) {
  if (device.is_cpu()) return cpu_depth_backend();
#if APVI_WITH_CUDA
  if (device.is_cuda()) return cuda_depth_backend();
#endif
  TORCH_CHECK(false, "this build estimates no depth on ", device);
}

}  // namespace apvi::mapping
