// SPDX-License-Identifier: BSD-3-Clause
#include "core/task_claim.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <sstream>
#include <system_error>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/atomic_file.hpp"
#include "core/text_file.hpp"

namespace apvi {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kBeat{1};

std::string host_name() {
  std::array<char, 256> name{};
  return gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "unknown";
}

/// Content of a claim: "HOST PID BEATS PROGRESS".
struct Content {
  std::string host;
  int pid = 0;
  int beats = 0;
  double progress = 0.0;
};

std::optional<Content> parse(const std::string& text) {
  std::istringstream in(text);
  Content content;
  if (in >> content.host >> content.pid >> content.beats >> content.progress) return content;
  return std::nullopt;
}

bool is_running(int pid) {
  return kill(pid, 0) == 0 || errno == EPERM;
}

}  // namespace

std::unique_ptr<TaskClaim> TaskClaim::take(const fs::path& file) {
  // "x": fails when the file exists, also when two processes try at once.
  std::FILE* const created = std::fopen(file.c_str(), "wx");
  if (created == nullptr) {
    if (errno == EEXIST) return nullptr;
    fail_run("{}: {}", file.string(), std::strerror(errno));
  }
  std::fclose(created);
  return std::unique_ptr<TaskClaim>(new TaskClaim(file));
}

TaskClaim::TaskClaim(fs::path file) : file_(std::move(file)) {
  write();
  thread_ = std::thread([this] { keep_alive(); });
}

TaskClaim::~TaskClaim() {
  {
    const std::lock_guard lock(mutex_);
    released_ = true;
  }
  condition_.notify_all();
  thread_.join();
  std::error_code ignored;
  fs::remove(file_, ignored);
}

void TaskClaim::write() {
  write_file_atomically(file_, [this](std::ostream& out) {
    out << fmt::format("{} {} {} {:.4f}\n", host_name(), getpid(), beats_++, progress_.load());
  });
}

void TaskClaim::keep_alive() {
  std::unique_lock lock(mutex_);
  while (!condition_.wait_for(lock, kBeat, [this] { return released_; })) {
    try {
      write();
    } catch (const std::exception& error) {
      log::warning("{}", error.what());  // a full disk: the task itself will fail
    }
  }
}

std::optional<double> claimed_progress(const fs::path& file) {
  const auto content = parse(read_text(file));
  return content ? std::optional(content->progress) : std::nullopt;
}

bool DeadClaims::remove_if_dead(const fs::path& file) {
  if (!fs::exists(file)) {
    seen_.erase(file);
    return false;
  }
  const std::string text = read_text(file);
  Seen& seen = seen_[file];
  if (seen.content != text) seen = {text, {}};
  const auto content = parse(text);
  const bool died_here = content && content->host == host_name() && !is_running(content->pid);
  if (!died_here && seen.since.seconds() < timeout_s_) return false;
  log::warning("{}: the process that worked on it has died", file.string());
  std::error_code ignored;
  fs::remove(file, ignored);
  seen_.erase(file);
  return true;
}

}  // namespace apvi
