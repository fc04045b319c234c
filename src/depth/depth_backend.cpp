// SPDX-License-Identifier: BSD-3-Clause
// Selects among the depth backends of this build.
#include "depth/depth_backend.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

namespace apvi::depth {

int best_view_count(int seen, double best_share) {
  constexpr int kMinViews = 4;  // fewer may agree by chance
  return std::max(std::min(seen, kMinViews), static_cast<int>(std::ceil(best_share * seen)));
}

float SmoothInput::lambda(int round) const {
  const int rounds = options.iterations;
  const double share = 1.5 * std::pow(4.0, rounds - round) / (std::pow(4.0, rounds) - 1.0);
  return static_cast<float>(share * options.lambda);
}

const DepthBackend& depth_backend(const torch::Device& device) {
  if (device.is_cpu()) return cpu_depth_backend();
#if APVI_WITH_CUDA
  if (device.is_cuda()) return cuda_depth_backend();
#endif
  TORCH_CHECK(false, "depth: this build has no backend for ", device);
}

}  // namespace apvi::depth
