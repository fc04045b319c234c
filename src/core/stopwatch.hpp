// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>

namespace apvi {

/// Wall-clock seconds since construction or the last reset, on the monotonic clock.
class Stopwatch {
 public:
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }
  void reset() { start_ = std::chrono::steady_clock::now(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// Adds the seconds until it is destroyed to a total.
class TimedScope {
 public:
  explicit TimedScope(double& total_s) : total_s_(total_s) {}
  ~TimedScope() { total_s_ += watch_.seconds(); }
  TimedScope(const TimedScope&) = delete;
  TimedScope& operator=(const TimedScope&) = delete;

 private:
  double& total_s_;
  Stopwatch watch_;
};

}  // namespace apvi
