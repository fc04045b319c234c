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
  /// Measures until it is destroyed.
  class Scope {
   public:
    explicit Scope(double& seconds) : seconds_(seconds) {}
    ~Scope() { seconds_ += watch_.seconds(); }
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;

   private:
    double& seconds_;
    Stopwatch watch_;
  };

  /// The result must not outlive the profiler.
  [[nodiscard]] Scope scope(std::string_view activity) {
    return Scope(seconds_.try_emplace(std::string(activity)).first->second);
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
