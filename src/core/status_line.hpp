// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <string>
#include <string_view>

namespace apvi {

/// Progress display on standard error: a line updated in place on a terminal, or a plain line every
/// few seconds elsewhere (log file, CI).
class StatusLine {
 public:
  explicit StatusLine(std::string label);
  ~StatusLine();
  StatusLine(const StatusLine&) = delete;
  StatusLine& operator=(const StatusLine&) = delete;

  /// `fraction` in [0, 1], or negative when the total is unknown; `detail` follows it. Rate-limited
  /// to ten updates a second on a terminal, and one every five seconds elsewhere.
  void update(double fraction, std::string_view detail);
  /// Removes the line from a terminal.
  void finish();

  /// Clears a status line that is currently shown, before other output to the terminal.
  static void clear_current();

 private:
  using Clock = std::chrono::steady_clock;
  std::string label_;
  Clock::time_point started_ = Clock::now();
  Clock::time_point printed_{};
  bool terminal_ = false;
};

}  // namespace apvi
