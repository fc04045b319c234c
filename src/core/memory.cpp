// SPDX-License-Identifier: BSD-3-Clause
#include "core/memory.hpp"

#include <sys/resource.h>

namespace apvi {

double peak_memory_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

}  // namespace apvi
