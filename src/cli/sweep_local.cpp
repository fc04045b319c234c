// SPDX-License-Identifier: BSD-3-Clause
// Runs cases as processes on this machine.
#include <chrono>
#include <list>
#include <thread>
#include <vector>

#include "apvi/core/log.hpp"
#include "cli/sweep_task.hpp"
#include "core/stopwatch.hpp"

namespace apvi::cli {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kPollInterval{20};
constexpr double kStopTimeout_s = 60.0;  // until a process that was asked to stop is killed

// Runs the open cases, a limited number in parallel.
class Runner {
 public:
  explicit Runner(const SweepLaunch& launch)
      : launch_(launch), jobs_(launch.jobs > 0 ? static_cast<std::size_t>(launch.jobs) : 1) {
    for (SweepTask& task : launch.tasks) {
      if (task.row.state == eval::SweepRow::State::open) waiting_.push_back(&task);
    }
  }

  /// Returns false when interrupted.
  bool run(const InterruptGuard& guard) {
    while (!waiting_.empty() || !running_.empty()) {
      if (guard.interrupted()) {
        stop_all();
        return false;
      }
      while (!waiting_.empty() && running_.size() < jobs_) start_next();
      poll_all();
      std::this_thread::sleep_for(kPollInterval);
    }
    return true;
  }

 private:
  struct Running {
    SweepTask* task;
    ChildProcess process;
    Stopwatch watch;
  };

  void start_next() {
    SweepTask& task = *waiting_.front();
    waiting_.pop_front();
    std::filesystem::remove(task.file(".done"));
    log::info("{}: started", task.name);
    ChildProcess process(arguments_of(task, task.file(".yaml")), task.file(".log"));
    running_.push_back({&task, std::move(process), {}});
  }

  void poll_all() {
    for (auto it = running_.begin(); it != running_.end();) {
      const std::optional<ChildExit> exit = it->process.poll();
      if (!exit) {
        ++it;
        continue;
      }
      SweepTask& task = *it->task;
      finish(task, *exit);
      if (exit->success()) log::info("{}: done in {:.1f} s", task.name, it->watch.seconds());
      launch_.changed();
      it = running_.erase(it);
    }
  }

  // Stopped cases stay unfinished, whatever their exit status.
  void stop_all() {
    log::warning("interrupted; stopping {} running cases", running_.size());
    std::vector<ChildProcess*> processes;
    for (Running& r : running_) processes.push_back(&r.process);
    apvi::stop_all(processes, kStopTimeout_s);
    running_.clear();
  }

  const SweepLaunch& launch_;
  std::size_t jobs_;
  std::list<SweepTask*> waiting_;
  std::list<Running> running_;
};

}  // namespace

bool run_locally(const SweepLaunch& launch, const InterruptGuard& guard) {
  return Runner(launch).run(guard);
}

}  // namespace apvi::cli
