// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <compare>
#include <cstdint>
#include <limits>

namespace apvi {

/// Time span in integer nanoseconds. Seconds as double are used only inside formulas.
struct Duration {
  std::int64_t ns = 0;

  /// Nearest nanosecond; saturates at the range of the type, NaN becomes zero.
  static Duration from_seconds(double seconds);
  double seconds() const { return 1e-9 * static_cast<double>(ns); }

  friend constexpr auto operator<=>(Duration, Duration) = default;
  friend constexpr Duration operator+(Duration a, Duration b) { return {a.ns + b.ns}; }
  friend constexpr Duration operator-(Duration a, Duration b) { return {a.ns - b.ns}; }
  friend constexpr Duration operator-(Duration a) { return {-a.ns}; }
};

/// Time stamp: nanoseconds since the epoch of the data set (Unix or device clock).
struct Stamp {
  std::int64_t ns = 0;

  double seconds() const { return 1e-9 * static_cast<double>(ns); }
  static constexpr Stamp max() { return {std::numeric_limits<std::int64_t>::max()}; }
  static constexpr Stamp min() { return {std::numeric_limits<std::int64_t>::min()}; }

  friend constexpr auto operator<=>(Stamp, Stamp) = default;
  friend constexpr Duration operator-(Stamp a, Stamp b) { return {a.ns - b.ns}; }
  friend constexpr Stamp operator+(Stamp a, Duration d) { return {a.ns + d.ns}; }
  friend constexpr Stamp operator-(Stamp a, Duration d) { return {a.ns - d.ns}; }
};

/// Seconds from `from` to `to`; the difference is taken in nanoseconds, so no precision is lost.
inline double seconds_between(Stamp from, Stamp to) {
  return (to - from).seconds();
}

}  // namespace apvi
