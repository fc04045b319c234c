// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>

#include "apvi/core/stamp.hpp"

namespace apvi::live {

/// The host's clock: Unix time when the program started, and steady from there on, so that a time
/// server that sets the system's clock does not disturb the stamps.
inline Stamp host_now() {
  static const auto unix_start = std::chrono::system_clock::now().time_since_epoch();
  static const auto steady_start = std::chrono::steady_clock::now();
  const auto now = unix_start + (std::chrono::steady_clock::now() - steady_start);
  return {std::chrono::duration_cast<std::chrono::nanoseconds>(now).count()};
}

}  // namespace apvi::live
