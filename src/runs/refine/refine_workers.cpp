// SPDX-License-Identifier: BSD-3-Clause
#include "runs/refine/refine_workers.hpp"

#include <fmt/format.h>
#include <torch/cuda.h>

#include <chrono>
#include <cstdlib>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/child_process.hpp"
#include "core/status_line.hpp"
#include "core/stopwatch.hpp"
#include "core/task_claim.hpp"
#include "core/text.hpp"
#include "core/text_file.hpp"
#include "runs/refine/refine_task.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::milliseconds kPollInterval{200};
constexpr double kReportInterval_s = 0.5;
constexpr int kMaxFailures = 3;
constexpr std::size_t kCachedBytes = std::size_t{2} << 30;  // of images, of each process
constexpr double kStopTimeout_s = 120.0;  // a checkpoint of a large block takes a while

fs::path claim_file(const fs::path& folder, const RefineTask& task) {
  return task_file(folder, task, ".claim");
}

/// The tasks of the first round that is not done; none when all are.
std::vector<RefineTask> open_tasks(const fs::path& folder, const RefinePlan& plan) {
  std::vector<RefineTask> open;
  for (RefineTask task; task.round < plan.rounds && open.empty(); ++task.round) {
    for (task.block = 0; task.block < plan.partition.size(); ++task.block) {
      if (!fs::exists(result_file(folder, task))) open.push_back(task);
    }
  }
  return open;
}

struct ClaimedTask {
  RefineTask task;
  std::unique_ptr<TaskClaim> claim;
};

std::optional<ClaimedTask> claim_one(const fs::path& folder, const std::vector<RefineTask>& open,
                                     DeadClaims& dead) {
  for (const RefineTask& task : open) {
    const fs::path file = claim_file(folder, task);
    dead.remove_if_dead(file);
    auto claim = TaskClaim::take(file);
    // Another process may have finished it between the look and the claim.
    if (claim && !fs::exists(result_file(folder, task))) return ClaimedTask{task, std::move(claim)};
  }
  return std::nullopt;
}

/// Names of the GPUs for CUDA_VISIBLE_DEVICES: those that this process may use.
std::vector<std::string> visible_devices() {
  std::vector<std::string> names;
  if (const char* const visible = std::getenv("CUDA_VISIBLE_DEVICES"); visible != nullptr) {
    std::vector<std::string_view> parts;
    text::split(visible, ',', parts);
    for (const std::string_view part : parts) names.emplace_back(part);
    return names;
  }
  const auto count = static_cast<std::size_t>(torch::cuda::device_count());
  for (std::size_t i = 0; i < count; ++i) names.push_back(std::to_string(i));
  return names;
}

/// Starts and watches the processes.
class Supervisor {
 public:
  Supervisor(const fs::path& folder, const RefinePlan& plan, const WorkerProcesses& processes)
      : folder_(folder), plan_(plan), processes_(processes), devices_(visible_devices()) {
    for (int i = 0; i < processes.count; ++i) start(i);
  }

  bool run(const Interrupted& interrupted) {
    StatusLine status("refining");
    while (!running_.empty()) {
      if (interrupted()) {
        stop_all();
        return false;
      }
      poll_all();
      status.update(refine_progress(folder_, plan_), fmt::format("{} processes", running_.size()));
      std::this_thread::sleep_for(kPollInterval);
    }
    if (!open_tasks(folder_, plan_).empty()) {
      fail_run("{}: the refinement cannot continue: {}; --resume tries again", folder_.string(),
               failure_);
    }
    return true;
  }

 private:
  struct Worker {
    int number;
    ChildProcess process;
  };

  fs::path log_of(int number) const {
    return refine_folder(folder_) / fmt::format("worker{}.log", number + 1);
  }

  void start(int number) {
    std::vector<std::string> command = {"/usr/bin/env"};
    if (!devices_.empty()) {
      command.push_back("CUDA_VISIBLE_DEVICES=" +
                        devices_[static_cast<std::size_t>(number) % devices_.size()]);
    }
    command.insert(command.end(),
                   {processes_.program.string(), "refine", "--join", folder_.string(), "--threads",
                    std::to_string(processes_.threads)});
    running_.push_back({number, ChildProcess(command, log_of(number))});
  }

  void poll_all() {
    std::vector<int> again;
    for (auto it = running_.begin(); it != running_.end();) {
      const auto exit = it->process.poll();
      if (!exit) {
        ++it;
        continue;
      }
      if (!exit->success()) {
        failure_ = fmt::format("{}: {}: {}", log_of(it->number).string(), exit->text(),
                               last_line(log_of(it->number)));
        log::warning("{}", failure_);
        if (++failures_ <= kMaxFailures) again.push_back(it->number);
      }
      it = running_.erase(it);
    }
    for (const int number : again) start(number);
  }

  void stop_all() {
    log::warning("interrupted; stopping {} processes, which save their state", running_.size());
    std::vector<ChildProcess*> processes;
    for (Worker& worker : running_) processes.push_back(&worker.process);
    apvi::stop_all(processes, kStopTimeout_s);
  }

  const fs::path& folder_;
  const RefinePlan& plan_;
  const WorkerProcesses& processes_;
  std::vector<std::string> devices_;
  std::list<Worker> running_;
  int failures_ = 0;
  std::string failure_;
};

}  // namespace

double refine_progress(const fs::path& folder, const RefinePlan& plan) {
  double done = 0.0;
  for (RefineTask task; task.round < plan.rounds; ++task.round) {
    for (task.block = 0; task.block < plan.partition.size(); ++task.block) {
      done += fs::exists(result_file(folder, task))
                  ? 1.0
                  : claimed_progress(claim_file(folder, task)).value_or(0.0);
    }
  }
  return done / (plan.rounds * plan.partition.size());
}

bool work(const fs::path& folder, const RefinePlan& plan, const Interrupted& interrupted) {
  DeadClaims dead;
  StatusLine status("refining");
  ImageCache images(kCachedBytes);
  for (;;) {
    if (interrupted()) return false;
    const std::vector<RefineTask> open = open_tasks(folder, plan);
    if (open.empty()) return true;
    const auto claimed = claim_one(folder, open, dead);
    if (!claimed) {
      std::this_thread::sleep_for(kPollInterval);
      continue;
    }
    const RefineTask& task = claimed->task;
    log::info("round {} of {}, block {} of {}", task.round + 1, plan.rounds, task.block + 1,
              plan.partition.size());
    Stopwatch since_report;
    const auto report = [&](double progress) {
      claimed->claim->set_progress(progress);
      if (since_report.seconds() < kReportInterval_s) return;
      status.update(refine_progress(folder, plan), "");
      since_report.reset();
    };
    if (!run_task(folder, plan, task, images, {.interrupted = interrupted, .progress = report})) {
      return false;
    }
  }
}

bool work_in_processes(const fs::path& folder, const RefinePlan& plan,
                       const WorkerProcesses& processes, const Interrupted& interrupted) {
  return Supervisor(folder, plan, processes).run(interrupted);
}

}  // namespace apvi::runs
