// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <condition_variable>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "core/stopwatch.hpp"

namespace apvi {

/// A process's claim on a task, as a file in a folder that several processes share, perhaps on
/// several hosts. The file is rewritten every second while the claim is held, so that others see
/// when its process has died.
class TaskClaim {
 public:
  /// Nothing when the file exists. Throws RunError when it cannot be written.
  static std::unique_ptr<TaskClaim> take(const std::filesystem::path& file);
  /// Removes the file.
  ~TaskClaim();
  TaskClaim(const TaskClaim&) = delete;
  TaskClaim& operator=(const TaskClaim&) = delete;

  /// Progress of the task, 0 to 1, for others to read.
  void set_progress(double progress) { progress_ = progress; }

 private:
  explicit TaskClaim(std::filesystem::path file);
  void keep_alive();
  void write();

  std::filesystem::path file_;
  std::atomic<double> progress_{0.0};
  int beats_ = 0;
  std::mutex mutex_;
  std::condition_variable condition_;
  bool released_ = false;
  std::thread thread_;
};

/// The progress in a claim's file; nothing when nobody holds the claim.
std::optional<double> claimed_progress(const std::filesystem::path& file);

/// Finds claims whose process has died: at once on this host, otherwise when the file does not
/// change for `timeout_s`.
class DeadClaims {
 public:
  explicit DeadClaims(double timeout_s = 60.0) : timeout_s_(timeout_s) {}

  /// Removes the claim if its process has died; returns whether it did.
  bool remove_if_dead(const std::filesystem::path& file);

 private:
  struct Seen {
    std::string content;
    Stopwatch since;
  };

  double timeout_s_;
  std::map<std::filesystem::path, Seen> seen_;
};

}  // namespace apvi
