// SPDX-License-Identifier: BSD-3-Clause
#include "config/sweep.hpp"

#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "cli/configurations.hpp"
#include "cli/sweep_task.hpp"
#include "core/text_file.hpp"
#include "eval/sweep_summary.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;
using eval::SweepRow;

struct Arguments {
  std::vector<fs::path> files;
  fs::path folder;
  int jobs = 0;
  std::string launcher = "local";
  std::vector<std::string> sbatch;
};

void write_summary(const std::vector<SweepTask>& tasks, const std::vector<std::string>& columns,
                   const fs::path& folder) {
  std::vector<SweepRow> rows;
  for (const SweepTask& task : tasks) rows.push_back(task.row);
  write_text(folder / "summary.csv", eval::sweep_csv(rows));
  write_text(folder / "summary.md", eval::sweep_table(rows, columns));
}

std::size_t count(const std::vector<SweepTask>& tasks, SweepRow::State state) {
  std::size_t n = 0;
  for (const SweepTask& task : tasks) n += task.row.state == state ? 1 : 0;
  return n;
}

std::vector<SweepTask> make_tasks(const config::Sweep& sweep, const fs::path& folder) {
  std::vector<SweepTask> tasks;
  for (const config::SweepCase& one : sweep.cases) {
    tasks.push_back(make_task(one, sweep.file.command, folder));
    load_if_finished(tasks.back());
  }
  return tasks;
}

/// The cases of a sweep file and their output folder.
struct Sweep {
  std::vector<std::string> columns;
  std::vector<SweepTask> tasks;
  fs::path folder;
};

// Reads all cases of all files before the first one starts.
std::vector<Sweep> load(const Arguments& a) {
  std::vector<Sweep> sweeps;
  for (const fs::path& file : a.files) {
    fs::path folder = a.folder.empty() ? fs::path("runs") / file.stem() : a.folder;
    if (!a.folder.empty() && a.files.size() > 1) folder /= file.stem();
    for (const Sweep& other : sweeps) {
      if (other.folder != folder) continue;
      fail_input("{}: two sweeps with this name would share {}: run them separately with -o",
                 file.string(), folder.string());
    }
    const config::Sweep sweep =
        config::load_sweep(find_configuration(file), configuration_folders());
    sweeps.push_back({sweep.file.columns, make_tasks(sweep, folder), folder});
  }
  return sweeps;
}

/// Number of finished and failed cases.
struct Outcome {
  std::size_t done = 0;
  std::size_t failed = 0;
  bool interrupted = false;
};

Outcome run_one(Sweep& sweep, const Arguments& a, const InterruptGuard& guard) {
  std::vector<SweepTask>& tasks = sweep.tasks;
  log::info("{} cases, {} already finished", tasks.size(), count(tasks, SweepRow::State::done));
  const SweepLaunch launch{
      .tasks = tasks, .folder = sweep.folder, .jobs = a.jobs, .sbatch = a.sbatch, .changed = [&] {
        write_summary(tasks, sweep.columns, sweep.folder);
      }};
  const bool complete =
      a.launcher == "slurm" ? run_on_slurm(launch, guard) : run_locally(launch, guard);
  launch.changed();
  std::fputs(read_text(sweep.folder / "summary.md").c_str(), stdout);
  log::info("results in {}", sweep.folder.string());
  return {count(tasks, SweepRow::State::done), count(tasks, SweepRow::State::failed), !complete};
}

void run_sweeps(const Arguments& a) {
  if (a.launcher != "slurm" && !a.sbatch.empty()) {
    fail_input("--sbatch: requires --launcher slurm");
  }
  std::vector<Sweep> sweeps = load(a);
  const InterruptGuard guard;
  std::size_t cases = 0;
  for (const Sweep& sweep : sweeps) cases += sweep.tasks.size();
  Outcome all;
  for (Sweep& sweep : sweeps) {
    if (sweeps.size() > 1) log::info("{}:", sweep.folder.string());
    const Outcome one = run_one(sweep, a, guard);
    all = {all.done + one.done, all.failed + one.failed, one.interrupted};
    if (all.interrupted) break;
  }
  if (all.interrupted) {
    fail_run("interrupted with {} of {} cases finished; run the same command to continue", all.done,
             cases);
  }
  if (all.failed > 0) fail_run("{} of {} cases failed", all.failed, cases);
}

}  // namespace

void add_sweep(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "sweep", "run many configurations and seeds and summarize them in a table; resumable");
  command
      ->add_option(
          "SWEEP", a->files,
          "sweep file, for example configs/ablations/sensors.yaml; several run one after another")
      ->type_name("FILE")
      ->required();
  command
      ->add_option("-o,--output", a->folder,
                   "output folder (default: runs/SWEEP); with several files the parent of their "
                   "folders")
      ->type_name("FOLDER");
  command
      ->add_option("-j,--jobs", a->jobs,
                   "number of parallel cases (default: 1; with Slurm no limit)")
      ->check(CLI::Range(1, 1024))
      ->type_name("N");
  command
      ->add_option("--launcher", a->launcher,
                   "where cases run: local (this machine) or slurm (a job array)")
      ->check(CLI::IsMember({"local", "slurm"}))
      ->type_name("WORD")
      ->capture_default_str();
  command
      ->add_option("--sbatch", a->sbatch,
                   "option passed to sbatch, e.g. --sbatch=--time=2:00:00; repeatable")
      ->type_name("OPTION")
      ->allow_extra_args(false);
  command->callback([a] { run_sweeps(*a); });
}

}  // namespace apvi::cli
