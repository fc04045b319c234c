// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::mapping {

/// The `count` training keyframes nearest to keyframe `i` in order, itself first.
inline std::vector<std::size_t> neighbors(const KeyframeStore& keyframes, std::size_t i,
                                          int count) {
  std::vector<std::size_t> all = keyframes.training();
  const auto distance = [i](std::size_t k) { return k > i ? k - i : i - k; };
  const auto nearer = [&](std::size_t a, std::size_t b) { return distance(a) < distance(b); };
  std::stable_sort(all.begin(), all.end(), nearer);
  all.resize(std::min(all.size(), static_cast<std::size_t>(count)));
  return all;
}

}  // namespace apvi::mapping
