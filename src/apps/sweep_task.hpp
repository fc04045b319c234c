// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "apvi/config/sweep.hpp"
#include "apvi/core/child_process.hpp"
#include "apvi/core/interrupt.hpp"
#include "apvi/eval/sweep_summary.hpp"

namespace apvi::apps {

/// One case of a sweep, its files, and what is known of it:
///   FOLDER/cases/NAME.yaml   complete configuration, to be run by hand too
///   FOLDER/cases/NAME.log    what the program printed
///   FOLDER/cases/NAME.done   that configuration in full, there when it has finished
///   FOLDER/NAME/             run folder or data set
struct SweepTask {
  config::SweepFile::Command command = config::SweepFile::Command::run;
  std::string name;
  std::filesystem::path stem;  ///< FOLDER/cases/NAME
  std::filesystem::path folder;
  std::string identity;  ///< what `.done` says when this very configuration has finished
  eval::SweepRow row;

  std::filesystem::path file(const char* ending) const { return stem.string() + ending; }
};

/// Writes the case's configuration and checks it. Throws InputError.
SweepTask make_task(const config::SweepCase& of, config::SweepFile::Command command,
                    const std::filesystem::path& folder);
/// Takes the metrics of a task that has finished; false of one that has not.
bool take_if_finished(SweepTask& task);
/// The program's arguments that run `configuration` as this task.
std::vector<std::string> arguments_of(const SweepTask& task,
                                      const std::filesystem::path& configuration);
/// Notes that a task ended by itself: done, or failed with the last thing it said.
void finish(SweepTask& task, const ChildExit& exit);
/// Likewise of one that did not come to its end.
void fail_task(SweepTask& task, const std::string& reason);

std::string read_text(const std::filesystem::path& file);
void write_text(const std::filesystem::path& file, const std::string& text);

/// How cases get run. Each runs the tasks whose state is `open`, calls `changed` after every one
/// that ended, and returns false when it was interrupted.
struct SweepLaunch {
  std::vector<SweepTask>& tasks;
  std::filesystem::path folder;  ///< of the sweep
  int jobs = 0;                  ///< at the same time; 0: as many as there are
  std::vector<std::string> sbatch;
  std::function<void()> changed;
};
bool run_here(const SweepLaunch& launch, const InterruptGuard& guard);
bool run_on_slurm(const SweepLaunch& launch, const InterruptGuard& guard);

}  // namespace apvi::apps
