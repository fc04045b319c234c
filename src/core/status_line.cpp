// SPDX-License-Identifier: BSD-3-Clause
#include "core/status_line.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <cstdio>

namespace apvi {
namespace {

std::atomic<bool> line_is_visible = false;  // the terminal is per process

std::string remaining(double fraction, double elapsed_s) {
  if (fraction < 0.01 || elapsed_s < 1.0) return "";
  const int left = static_cast<int>(std::lround(elapsed_s * (1.0 - fraction) / fraction));
  return left >= 60 ? fmt::format(" {}m{:02d}s left", left / 60, left % 60)
                    : fmt::format(" {}s left", left);
}

}  // namespace

StatusLine::StatusLine(std::string label)
    : label_(std::move(label)), terminal_(isatty(STDERR_FILENO) == 1) {}

StatusLine::~StatusLine() {
  finish();
}

void StatusLine::update(double fraction, std::string_view detail) {
  const auto now = Clock::now();
  const auto period = terminal_ ? std::chrono::milliseconds(100) : std::chrono::milliseconds(5000);
  if (now - (printed_ == Clock::time_point{} && !terminal_ ? started_ : printed_) < period) return;
  printed_ = now;
  const double elapsed_s = std::chrono::duration<double>(now - started_).count();
  std::string line = fmt::format("{}:", label_);
  if (fraction >= 0.0) line += fmt::format(" {:3.0f} %", 100.0 * fraction);
  if (!detail.empty()) line += fmt::format(" {}", detail);
  line += remaining(fraction, elapsed_s);
  if (terminal_) {
    std::fprintf(stderr, "\r\033[K%s", line.c_str());
    line_is_visible = true;
  } else {
    std::fprintf(stderr, "%s\n", line.c_str());
  }
  std::fflush(stderr);
}

void StatusLine::finish() {
  if (terminal_) clear_current();
}

void StatusLine::clear_current() {
  if (line_is_visible.exchange(false)) std::fputs("\r\033[K", stderr);
}

}  // namespace apvi
