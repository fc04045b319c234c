// SPDX-License-Identifier: BSD-3-Clause
#include "core/child_process.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <system_error>
#include <thread>
#include <utility>

#include "apvi/core/error.hpp"
#include "core/stopwatch.hpp"

namespace apvi {
namespace {

// Spawn settings: no input, output to a file, own process group, default signal handling.
class SpawnSetup {
 public:
  explicit SpawnSetup(const std::filesystem::path& output) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawn_file_actions_addopen(&actions_, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions_, STDOUT_FILENO, output.c_str(),
                                     O_WRONLY | O_CREAT | O_TRUNC, 0644);
    posix_spawn_file_actions_adddup2(&actions_, STDOUT_FILENO, STDERR_FILENO);
    posix_spawnattr_init(&attributes_);
    posix_spawnattr_setpgroup(&attributes_, 0);
    sigset_t signals;
    sigemptyset(&signals);
    posix_spawnattr_setsigmask(&attributes_, &signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    posix_spawnattr_setsigdefault(&attributes_, &signals);
    posix_spawnattr_setflags(
        &attributes_, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  }
  ~SpawnSetup() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
  }
  SpawnSetup(const SpawnSetup&) = delete;
  SpawnSetup& operator=(const SpawnSetup&) = delete;

  const posix_spawn_file_actions_t* actions() const { return &actions_; }
  const posix_spawnattr_t* attributes() const { return &attributes_; }

 private:
  posix_spawn_file_actions_t actions_{};
  posix_spawnattr_t attributes_{};
};

ChildExit to_child_exit(int raw) {
  return WIFSIGNALED(raw) ? ChildExit{0, WTERMSIG(raw)} : ChildExit{WEXITSTATUS(raw), 0};
}

}  // namespace

std::string ChildExit::text() const {
  if (signal == 0) return fmt::format("exit status {}", status);
  return fmt::format("killed by signal {} ({})", signal, strsignal(signal));
}

ChildProcess::ChildProcess(const std::vector<std::string>& arguments,
                           const std::filesystem::path& output) {
  std::vector<char*> argv;
  // posix_spawn does not modify the strings.
  for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  const SpawnSetup setup(output);
  const int error =
      posix_spawn(&pid_, argv[0], setup.actions(), setup.attributes(), argv.data(), environ);
  if (error != 0) {
    pid_ = -1;
    fail_run("{}: cannot start this program with its output in {}: {}", arguments.front(),
             output.string(), std::generic_category().message(error));
  }
}

ChildProcess::~ChildProcess() {
  if (pid_ < 0) return;
  kill();
  waitpid(pid_, nullptr, 0);
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : pid_(std::exchange(other.pid_, -1)), exit_(other.exit_) {}

std::optional<ChildExit> ChildProcess::poll() {
  int raw = 0;
  if (pid_ > 0 && waitpid(pid_, &raw, WNOHANG) == pid_) {
    pid_ = -1;
    exit_ = to_child_exit(raw);
  }
  return exit_;
}

void ChildProcess::stop() {
  if (pid_ > 0) ::kill(pid_, SIGINT);
}

void ChildProcess::kill() {
  if (pid_ > 0) ::kill(pid_, SIGKILL);
}

void stop_all(std::span<ChildProcess* const> processes, double timeout_s) {
  for (ChildProcess* const process : processes) process->stop();
  const Stopwatch watch;
  for (ChildProcess* const process : processes) {
    while (!process->poll()) {
      if (watch.seconds() > timeout_s) process->kill();
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
}

std::filesystem::path current_executable() {
  std::error_code error;
  auto path = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) fail_run("/proc/self/exe: cannot read: {}", error.message());
  return path;
}

}  // namespace apvi
