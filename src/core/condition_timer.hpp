// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "apvi/core/stamp.hpp"

namespace apvi {

/// For how long a condition has held without interruption.
class ConditionTimer {
 public:
  /// Processes whether the condition holds at `now`. Returns for how long it has held [s]: 0 at its
  /// first stamp; nullopt if it does not hold.
  std::optional<double> update(Stamp now, bool holds) {
    if (!holds) {
      since_.reset();
      return std::nullopt;
    }
    if (!since_) since_ = now;
    return seconds_between(*since_, now);
  }

  /// For how long the condition has held at `now` [s]; nullopt if it did not at the last update.
  std::optional<double> elapsed(Stamp now) const {
    if (!since_) return std::nullopt;
    return seconds_between(*since_, now);
  }

  void reset() { since_.reset(); }

 private:
  std::optional<Stamp> since_;
};

}  // namespace apvi
