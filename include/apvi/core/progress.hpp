// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <string>
#include <string_view>

namespace apvi {

/// Progress of long work on standard error: one line that rewrites itself on a terminal, a plain
/// line every few seconds anywhere else (a log file, CI).
class StatusLine {
 public:
  explicit StatusLine(std::string label);
  ~StatusLine();
  StatusLine(const StatusLine&) = delete;
  StatusLine& operator=(const StatusLine&) = delete;

  /// `fraction` in [0, 1], or negative when the total is not known; `detail` follows it. Cheap: it
  /// prints at most ten times a second on a terminal and every five seconds elsewhere.
  void update(double fraction, std::string_view detail);
  /// Removes the line from a terminal.
  void finish();

  /// Erases a status line that is on the terminal now, so that other output can start clean.
  static void erase_shown();

 private:
  using Clock = std::chrono::steady_clock;
  std::string label_;
  Clock::time_point started_ = Clock::now();
  Clock::time_point printed_{};
  bool terminal_ = false;
};

}  // namespace apvi
