// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace apvi {

/// How a process ended.
struct ChildExit {
  int status = 0;  ///< exit status; 0 when a signal ended it
  int signal = 0;  ///< 0: it ended by itself

  bool success() const { return status == 0 && signal == 0; }
  /// "exit status 2", "killed by signal 11 (Segmentation fault)".
  std::string text() const;
};

/// A program that runs beside this one, with its output in a file and a process group of its own,
/// so that Ctrl-C at the terminal reaches it only by `stop`.
class ChildProcess {
 public:
  /// Starts `arguments[0]`, a path. Throws RunError when it cannot be started.
  ChildProcess(const std::vector<std::string>& arguments, const std::filesystem::path& output);
  /// Ends it the hard way if it still runs.
  ~ChildProcess();
  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&&) = delete;

  /// How it ended; nothing while it runs. Does not wait.
  std::optional<ChildExit> poll();
  /// Asks it to stop as Ctrl-C would.
  void stop();
  void kill();

 private:
  int pid_ = -1;  // -1: ended, or moved from
  std::optional<ChildExit> exit_;
};

/// The program that is running, to start it once more. Throws RunError where the system does not
/// tell.
std::filesystem::path own_program();

}  // namespace apvi
