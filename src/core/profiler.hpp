// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "core/stopwatch.hpp"

namespace apvi {

/// Accumulated wall-clock time by activity, for a single thread. Time in a nested scope also counts
/// for the enclosing ones.
class Profiler {
 public:
  /// Measures until the result is destroyed, which must not outlive the profiler.
  [[nodiscard]] TimedScope scope(std::string_view activity) {
    return TimedScope(seconds_.try_emplace(std::string(activity)).first->second);
  }
  /// 0 for an unknown activity.
  double seconds(std::string_view activity) const {
    const auto found = seconds_.find(activity);
    return found == seconds_.end() ? 0.0 : found->second;
  }
  const std::map<std::string, double, std::less<>>& seconds() const { return seconds_; }

 private:
  std::map<std::string, double, std::less<>> seconds_;
};

}  // namespace apvi
