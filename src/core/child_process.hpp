// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace apvi {

/// How a process terminated.
struct ChildExit {
  int status = 0;  ///< exit status; 0 if terminated by a signal
  int signal = 0;  ///< terminating signal; 0 after a normal exit

  bool success() const { return status == 0 && signal == 0; }
  /// "exit status 2", "killed by signal 11 (Segmentation fault)".
  std::string text() const;
};

/// A child process with its output redirected to a file. It has its own process group, so Ctrl-C at
/// the terminal reaches it only through `stop`.
class ChildProcess {
 public:
  /// Starts `arguments[0]`, a path. Throws RunError when it cannot be started.
  ChildProcess(const std::vector<std::string>& arguments, const std::filesystem::path& output);
  /// Kills the process if it is still running.
  ~ChildProcess();
  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&&) = delete;

  /// How it terminated; nullopt while it is running. Does not block.
  std::optional<ChildExit> poll();
  /// Sends SIGINT, as Ctrl-C does.
  void stop();
  void kill();

 private:
  int pid_ = -1;  // -1: terminated, or moved from
  std::optional<ChildExit> exit_;
};

/// Stops the processes as Ctrl-C does, waits until all have exited, and kills those that have not
/// after `timeout_s`.
void stop_all(std::span<ChildProcess* const> processes, double timeout_s);

/// Path of the running executable. Throws RunError if the system does not provide it.
std::filesystem::path current_executable();

}  // namespace apvi
