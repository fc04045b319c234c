// SPDX-License-Identifier: BSD-3-Clause
#include "memory_economy.hpp"

#include <c10/util/Exception.h>

#include "apvi/core/log.hpp"
#include "apvi/splat/device.hpp"

namespace apvi::mapping {
namespace {

// Large steps, because what is free in pieces is of no use to the next large tensor.
constexpr double kEconomy = 0.8;   // of the Gaussians stay
constexpr int kMostEconomies = 4;  // for one thing to do: half a map fits where any does

}  // namespace

void within_memory(const std::function<void()>& work, const std::function<bool()>& economise) {
  for (int economies = 0;; ++economies) {
    try {
      return work();
    } catch (const c10::Error& error) {
      if (economies == kMostEconomies || !splat::is_out_of_memory(error) || !economise()) throw;
    }
  }
}

bool shrink(MapLearner& learner, int& max_gaussians) {
  if (learner.size() < kFewestToShrink) return false;
  const auto most = static_cast<int>(kEconomy * static_cast<double>(learner.size()));
  log::warning(
      "no memory left on the device: the map goes on with {} Gaussians at most, those that count "
      "most, instead of {}",
      most, max_gaussians);
  max_gaussians = most;
  learner.keep_best(most);
  return true;
}

}  // namespace apvi::mapping
