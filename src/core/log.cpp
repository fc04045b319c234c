// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/core/log.hpp"

#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/dist_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <memory>
#include <mutex>

#include "apvi/core/error.hpp"
#include "core/status_line.hpp"

namespace apvi::log {
namespace {

// Standard error is process-wide, and therefore so is its logger.
struct Sinks {
  std::mutex mutex;
  std::shared_ptr<spdlog::sinks::stderr_color_sink_mt> console =
      std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
  std::shared_ptr<spdlog::sinks::basic_file_sink_mt> file;

  Sinks() {
    console->set_pattern("%^%l%$: %v");
    console->set_level(spdlog::level::info);  // -v shows more
  }
};

Sinks& sinks() {
  static Sinks instance;
  return instance;
}

spdlog::level::level_enum to_spdlog(Level level) {
  switch (level) {
    case Level::debug:
      return spdlog::level::debug;
    case Level::info:
      return spdlog::level::info;
    case Level::warning:
      return spdlog::level::warn;
    case Level::error:
      return spdlog::level::err;
  }
  return spdlog::level::info;
}

}  // namespace

void set_console_level(Level level) {
  sinks().console->set_level(to_spdlog(level));
}

void open_file(const std::filesystem::path& path) {
  const std::scoped_lock lock(sinks().mutex);
  try {
    sinks().file = std::make_shared<spdlog::sinks::basic_file_sink_mt>(path.string(), true);
    sinks().file->set_pattern("%Y-%m-%d %H:%M:%S.%e %l: %v");
  } catch (const spdlog::spdlog_ex& e) {
    fail_run("{}: cannot write the log: {}", path.string(), e.what());
  }
}

void close_file() {
  const std::scoped_lock lock(sinks().mutex);
  sinks().file.reset();
}

void write(Level level, std::string_view message) {
  const std::scoped_lock lock(sinks().mutex);
  const spdlog::details::log_msg record("", to_spdlog(level),
                                        spdlog::string_view_t(message.data(), message.size()));
  if (sinks().console->should_log(record.level)) {
    StatusLine::clear_current();  // start on a clean line
    sinks().console->log(record);
  }
  if (sinks().file) {
    sinks().file->log(record);
    if (level != Level::debug) sinks().file->flush();
  }
}

}  // namespace apvi::log
