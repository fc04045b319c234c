// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/mapping/options.hpp"

namespace apvi::mapping {

/// Limits of what is kept in host memory for the parts of a map far from the camera [bytes].
struct StoredMemory {
  double gaussians = 0.0;
  double images = 0.0;
};

inline StoredMemory stored_memory(const OnlineOptions& options) {
  const double half = 0.5 * options.stored_memory_mib * 1024.0 * 1024.0;
  return {.gaussians = half, .images = half};
}

}  // namespace apvi::mapping
