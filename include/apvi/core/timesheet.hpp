// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "apvi/core/stopwatch.hpp"

namespace apvi {

/// Wall-clock seconds by activity. For one thread; what is entered within another entry counts for
/// both.
class Timesheet {
 public:
  /// Counts until it ends.
  class Entry {
   public:
    explicit Entry(double& seconds) : seconds_(seconds) {}
    ~Entry() { seconds_ += watch_.seconds(); }
    Entry(const Entry&) = delete;
    Entry& operator=(const Entry&) = delete;

   private:
    double& seconds_;
    Stopwatch watch_;
  };

  /// The result must not outlive the sheet.
  [[nodiscard]] Entry enter(std::string_view activity) {
    return Entry(seconds_.try_emplace(std::string(activity)).first->second);
  }
  /// 0 if it was never entered.
  double of(std::string_view activity) const {
    const auto found = seconds_.find(activity);
    return found == seconds_.end() ? 0.0 : found->second;
  }
  const std::map<std::string, double, std::less<>>& seconds() const { return seconds_; }

 private:
  std::map<std::string, double, std::less<>> seconds_;
};

}  // namespace apvi
