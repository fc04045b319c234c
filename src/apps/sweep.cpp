// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/config/sweep.hpp"

#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
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
  fs::path sweep;
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

void run_sweep(Arguments a) {
  if (a.launcher != "slurm" && !a.sbatch.empty()) {
    fail_input("--sbatch: is for --launcher slurm; add that, or leave it out");
  }
  const config::Sweep sweep = config::load_sweep(a.sweep);
  if (a.folder.empty()) a.folder = fs::path("runs") / a.sweep.stem();
  std::vector<SweepTask> tasks = make_tasks(sweep, a.folder);
  log::info("{} cases, {} finished already", tasks.size(), count(tasks, SweepRow::State::done));
  const SweepLaunch launch{
      .tasks = tasks, .folder = a.folder, .jobs = a.jobs, .sbatch = a.sbatch, .changed = [&] {
        write_summary(tasks, sweep.file.columns, a.folder);
      }};
  const InterruptGuard guard;
  const bool complete =
      a.launcher == "slurm" ? run_on_slurm(launch, guard) : run_here(launch, guard);
  launch.changed();
  std::fputs(read_text(a.folder / "summary.md").c_str(), stdout);
  log::info("results in {}", a.folder.string());
  if (!complete) {
    fail_run("interrupted with {} of {} cases finished; the same command goes on from there",
             count(tasks, SweepRow::State::done), tasks.size());
  }
  const std::size_t failed = count(tasks, SweepRow::State::failed);
  if (failed > 0) fail_run("{} of {} cases failed", failed, tasks.size());
}

}  // namespace

void add_sweep(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "sweep", "many runs over configurations and seeds, in one table; goes on where it stopped");
  command->add_option("SWEEP", a->sweep, "sweep file, for example configs/ablations/sensors.yaml")
      ->required();
  command->add_option("-o,--output", a->folder, "folder for all of it (default: runs/SWEEP)");
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
  command->callback([a] { run_sweep(*a); });
}

}  // namespace apvi::apps
