// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/stamp.hpp"

#include <cmath>

namespace apvi {

Duration Duration::from_seconds(double seconds) {
  constexpr double kLimit = 9.2e18;  // just below 2^63
  const double ns = seconds * 1e9;
  if (std::isnan(ns)) return {0};
  if (ns >= kLimit) return {std::numeric_limits<std::int64_t>::max()};
  if (ns <= -kLimit) return {std::numeric_limits<std::int64_t>::min()};
  return {std::llround(ns)};
}

}  // namespace apvi
