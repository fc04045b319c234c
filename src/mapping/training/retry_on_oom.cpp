// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/training/retry_on_oom.hpp"

#include <c10/util/Exception.h>

#include "apvi/core/log.hpp"
#include "gaussians/device.hpp"

namespace apvi::mapping {
namespace {

// Large steps, because fragmented free memory does not fit the next large tensor.
constexpr double kShrinkFactor = 0.8;  // fraction of Gaussians kept
constexpr int kMaxRetries = 4;         // per operation; leaves 0.8^4 = 41 % of the map

bool reduce_memory(MapOptimizer& optimizer, KeyframeStore& keyframes) {
  if (optimizer.size() < kMinGaussiansToShrink) return false;
  if (keyframes.device().is_cpu()) return shrink_map(optimizer);
  log::warning("out of GPU memory: keyframe images are moved to host memory");
  keyframes.move_images(torch::kCPU);
  return true;
}

}  // namespace

void retry_on_oom(const std::function<void()>& work, const std::function<bool()>& reduce_memory) {
  for (int retries = 0;; ++retries) {
    try {
      return work();
    } catch (const c10::Error& error) {
      if (retries == kMaxRetries || !gaussians::is_out_of_memory(error) || !reduce_memory()) throw;
    }
  }
}

void retry_on_oom(const std::function<void()>& work, MapOptimizer& optimizer,
                  KeyframeStore& keyframes) {
  retry_on_oom(work, [&] { return reduce_memory(optimizer, keyframes); });
}

bool shrink_map(MapOptimizer& optimizer) {
  if (optimizer.size() < kMinGaussiansToShrink) return false;
  const auto kept = static_cast<int>(kShrinkFactor * static_cast<double>(optimizer.size()));
  log::warning(
      "out of GPU memory: the map is reduced to the {} most important Gaussians, which is the new "
      "maximum instead of {}",
      kept, optimizer.max_gaussians());
  optimizer.keep_most_important(kept);
  return true;
}

}  // namespace apvi::mapping
