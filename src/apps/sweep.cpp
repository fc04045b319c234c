// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/config/sweep.hpp"

#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/eval/sweep_summary.hpp"
#include "commands.hpp"
#include "sweep_task.hpp"

namespace apvi::apps {
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
    take_if_finished(tasks.back());
  }
  return tasks;
}

/// A sweep file's cases and where their results go.
struct Sweep {
  std::vector<std::string> columns;
  std::vector<SweepTask> tasks;
  fs::path folder;
};

// All cases of all files are read before the first begins.
std::vector<Sweep> load(const Arguments& a) {
  std::vector<Sweep> sweeps;
  for (const fs::path& file : a.files) {
    fs::path folder = a.folder.empty() ? fs::path("runs") / file.stem() : a.folder;
    if (!a.folder.empty() && a.files.size() > 1) folder /= file.stem();
    for (const Sweep& other : sweeps) {
      if (other.folder != folder) continue;
      fail_input("{}: two sweeps of this name would share {}: run them one by one with -o",
                 file.string(), folder.string());
    }
    const config::Sweep sweep = config::load_sweep(file);
    sweeps.push_back({sweep.file.columns, make_tasks(sweep, folder), folder});
  }
  return sweeps;
}

/// How many cases of a sweep came to what.
struct Outcome {
  std::size_t done = 0;
  std::size_t failed = 0;
  bool interrupted = false;
};

Outcome run_one(Sweep& sweep, const Arguments& a, const InterruptGuard& guard) {
  std::vector<SweepTask>& tasks = sweep.tasks;
  log::info("{} cases, {} finished already", tasks.size(), count(tasks, SweepRow::State::done));
  const SweepLaunch launch{
      .tasks = tasks, .folder = sweep.folder, .jobs = a.jobs, .sbatch = a.sbatch, .changed = [&] {
        write_summary(tasks, sweep.columns, sweep.folder);
      }};
  const bool complete =
      a.launcher == "slurm" ? run_on_slurm(launch, guard) : run_here(launch, guard);
  launch.changed();
  std::fputs(read_text(sweep.folder / "summary.md").c_str(), stdout);
  log::info("results in {}", sweep.folder.string());
  return {count(tasks, SweepRow::State::done), count(tasks, SweepRow::State::failed), !complete};
}

void run_sweeps(const Arguments& a) {
  if (a.launcher != "slurm" && !a.sbatch.empty()) {
    fail_input("--sbatch: is for --launcher slurm; add that, or leave it out");
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
    fail_run("interrupted with {} of {} cases finished; the same command goes on from there",
             all.done, cases);
  }
  if (all.failed > 0) fail_run("{} of {} cases failed", all.failed, cases);
}

}  // namespace

void add_sweep(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "sweep", "many runs over configurations and seeds, in one table; goes on where it stopped");
  command
      ->add_option("SWEEP", a->files,
                   "sweep file, for example configs/ablations/sensors.yaml; of several one runs "
                   "after the other")
      ->required();
  command->add_option("-o,--output", a->folder,
                      "folder for all of it (default: runs/SWEEP); of several files each has a "
                      "folder of its name in it");
  command
      ->add_option("-j,--jobs", a->jobs,
                   "cases at the same time (default: 1; with Slurm as many as it has room for)")
      ->check(CLI::Range(1, 1024));
  command
      ->add_option("--launcher", a->launcher,
                   "where cases run: local (this machine) or slurm (a job array)")
      ->check(CLI::IsMember({"local", "slurm"}))
      ->type_name("WORD")
      ->capture_default_str();
  command
      ->add_option("--sbatch", a->sbatch,
                   "option handed to sbatch, like --sbatch=--time=2:00:00; any number of them")
      ->type_name("OPTION")
      ->allow_extra_args(false);
  command->callback([a] { run_sweeps(*a); });
}

}  // namespace apvi::apps
