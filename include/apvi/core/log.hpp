// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <string_view>
#include <utility>

/// Logging to standard error and, once a run folder exists, to a file in it. Only log.cpp sees the
/// logging library. Safe to call from any thread.
namespace apvi::log {

enum class Level { debug, info, warning, error };

/// Lowest level shown on standard error (the file takes everything from debug on).
void set_console_level(Level level);
/// Adds a log file; throws RunError when it cannot be opened. The file lives until `close_file`.
void open_file(const std::filesystem::path& path);
void close_file();
void write(Level level, std::string_view message);

template <typename... Args>
void debug(fmt::format_string<Args...> format, Args&&... args) {
  write(Level::debug, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void info(fmt::format_string<Args...> format, Args&&... args) {
  write(Level::info, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void warning(fmt::format_string<Args...> format, Args&&... args) {
  write(Level::warning, fmt::format(format, std::forward<Args>(args)...));
}
template <typename... Args>
void error(fmt::format_string<Args...> format, Args&&... args) {
  write(Level::error, fmt::format(format, std::forward<Args>(args)...));
}

}  // namespace apvi::log
