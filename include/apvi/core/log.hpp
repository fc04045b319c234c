// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <string_view>
#include <utility>

/// Logging to standard error and, after `open_file`, to a file. Only log.cpp depends on the logging
/// library. Thread-safe.
namespace apvi::log {

enum class Level { debug, info, warning, error };

/// Minimum level on standard error (the file receives all levels).
void set_console_level(Level level);
/// Adds a log file, used until `close_file`. Throws RunError when it cannot be opened.
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
