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

bool shrink_map(MapOptimizer& optimizer, int& max_gaussians) {
  if (optimizer.size() < kMinGaussiansToShrink) return false;
  const auto kept = static_cast<int>(kShrinkFactor * static_cast<double>(optimizer.size()));
  log::warning(
      "out of GPU memory: the map is reduced to the {} most important Gaussians, which is the new "
      "maximum instead of {}",
      kept, max_gaussians);
  max_gaussians = kept;
  optimizer.keep_most_important(kept);
  return true;
}

}  // namespace apvi::mapping
