// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/mapping/options.hpp"

namespace apvi::mapping {

/// Limits of what is kept for the parts of a map far from the camera [bytes].
struct StoredMemory {
  double gaussians = 0.0;  ///< in host memory
  double images = 0.0;     ///< in host memory
  double disk = 0.0;       ///< of both
};

inline StoredMemory stored_memory(const OnlineOptions& options) {
  constexpr double kMib = 1024.0 * 1024.0;
  const double half = 0.5 * options.stored_memory_mib * kMib;
  return {.gaussians = half, .images = half, .disk = options.stored_disk_mib * kMib};
}

}  // namespace apvi::mapping
