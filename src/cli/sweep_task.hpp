// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "config/sweep.hpp"
#include "core/child_process.hpp"
#include "core/interrupt.hpp"
#include "eval/sweep_summary.hpp"

namespace apvi::cli {

/// One case of a sweep, its files and its state:
///   FOLDER/cases/NAME.yaml   complete configuration, can be run manually
///   FOLDER/cases/NAME.log    output of the program
///   FOLDER/cases/NAME.done   the resolved configuration, written when the case has finished
///   FOLDER/NAME/             run folder or dataset
struct SweepTask {
  config::SweepFile::Command command = config::SweepFile::Command::run;
  std::string name;
  std::filesystem::path stem;  ///< FOLDER/cases/NAME
  std::filesystem::path folder;
  std::string identity;  ///< content of `.done` when exactly this configuration has finished
  eval::SweepRow row;

  std::filesystem::path file(const char* ending) const { return stem.string() + ending; }
};

/// Writes the case's configuration and checks it. Throws InputError.
SweepTask make_task(const config::SweepCase& of, config::SweepFile::Command command,
                    const std::filesystem::path& folder);
/// Loads the metrics of a finished task; returns false if it has not finished.
bool load_if_finished(SweepTask& task);
/// Command line that runs `configuration` as this task.
std::vector<std::string> arguments_of(const SweepTask& task,
                                      const std::filesystem::path& configuration);
/// Records that a task's process has exited: done, or failed with the last line of its log.
void finish(SweepTask& task, const ChildExit& exit);
/// Records that a task failed for another reason.
void fail_task(SweepTask& task, const std::string& reason);

void write_text(const std::filesystem::path& file, const std::string& text);

/// Launchers. Each runs the tasks whose state is `open`, calls `changed` after every finished one,
/// and returns false when interrupted.
struct SweepLaunch {
  std::vector<SweepTask>& tasks;
  std::filesystem::path folder;  ///< of the sweep
  int jobs = 0;                  ///< maximum number of parallel tasks; 0: launcher's default
  std::vector<std::string> sbatch;
  std::function<void()> changed;
};
bool run_locally(const SweepLaunch& launch, const InterruptGuard& guard);
bool run_on_slurm(const SweepLaunch& launch, const InterruptGuard& guard);

}  // namespace apvi::cli
