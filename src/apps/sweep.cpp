// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/config/sweep.hpp"

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <list>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "apvi/core/atomic_file.hpp"
#include "apvi/core/child_process.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/interrupt.hpp"
#include "apvi/core/log.hpp"
#include "apvi/core/stopwatch.hpp"
#include "apvi/core/text.hpp"
#include "apvi/eval/sweep_summary.hpp"
#include "apvi/sim/scene_config.hpp"
#include "commands.hpp"
#include "mapping_half.hpp"

namespace apvi::apps {
namespace {

namespace fs = std::filesystem;
using Command = config::SweepFile::Command;
using eval::SweepRow;
using std::chrono::milliseconds;

constexpr milliseconds kPollInterval{20};
constexpr double kPatience_s = 60.0;  // after which a child that was asked to stop is ended

struct Arguments {
  fs::path sweep;
  fs::path folder;
  int jobs = 1;
};

// One case, its files, and what is known of it:
//   FOLDER/cases/NAME.yaml   complete configuration, to be run by hand too
//   FOLDER/cases/NAME.log    what the program printed
//   FOLDER/cases/NAME.done   that configuration in full, written when it has finished
//   FOLDER/NAME/             run folder or data set
struct Task {
  const config::SweepCase* of = nullptr;
  std::string name;
  fs::path yaml;
  fs::path log;
  fs::path done;
  fs::path folder;
  std::string identity;
  SweepRow row;
};

std::string read_text(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

void write_text(const fs::path& file, const std::string& text) {
  write_file_atomically(file, [&](std::ostream& out) { out << text; });
}

void check_case(const fs::path& file, Command command) {
  if (command == Command::sim) {
    sim::load_scene(file, {});
  } else {
    load_run_config(file, {});
  }
}

Task make_task(const config::SweepCase& of, Command command, const fs::path& folder) {
  Task task;
  task.of = &of;
  task.name = of.folder().string();
  const fs::path stem = folder / "cases" / of.folder();
  task.yaml = stem.string() + ".yaml";
  task.log = stem.string() + ".log";
  task.done = stem.string() + ".done";
  task.folder = folder / of.folder();
  fs::create_directories(task.yaml.parent_path());
  write_text(task.yaml, config::to_yaml(of.config));
  check_case(task.yaml, command);
  task.identity = (command == Command::sim ? "# apvi sim\n" : "# apvi run\n") +
                  config::to_yaml(config::load_with_inheritance(task.yaml));
  task.row.group = of.group;
  task.row.choices = of.choices;
  task.row.seed = of.seed;
  return task;
}

bool is_finished(const Task& task, Command command) {
  const fs::path product = command == Command::sim ? task.folder : task.folder / "metrics.json";
  return fs::exists(product) && fs::exists(task.done) && read_text(task.done) == task.identity;
}

std::vector<std::string> arguments_of(const Task& task, Command command, const fs::path& program) {
  std::vector<std::string> arguments{program.string(), command == Command::sim ? "sim" : "run",
                                     task.yaml.string(), "-o", task.folder.string()};
  if (command == Command::run) arguments.emplace_back("--overwrite");
  return arguments;
}

void take_metrics(Task& task) {
  const fs::path file = task.folder / "metrics.json";
  if (fs::exists(file)) task.row.metrics = eval::flatten(eval::read_metrics(file));
}

// The last thing a program said is why it ended.
std::string last_line(const fs::path& log) {
  std::istringstream in(read_text(log));
  std::string last;
  for (std::string line; std::getline(in, line);) {
    if (!text::trim(line).empty()) last = text::trim(line);
  }
  return last;
}

void finish(Task& task, const ChildExit& exit) {
  if (exit.success()) {
    task.row.state = SweepRow::State::done;
    write_text(task.done, task.identity);
    take_metrics(task);
    return;
  }
  task.row.state = SweepRow::State::failed;
  const std::string said = last_line(task.log);
  task.row.reason = said.empty() ? exit.text() : fmt::format("{}: {}", exit.text(), said);
}

void write_summary(const std::vector<Task>& tasks, const std::vector<std::string>& columns,
                   const fs::path& folder) {
  std::vector<SweepRow> rows;
  for (const Task& task : tasks) rows.push_back(task.row);
  write_text(folder / "summary.csv", eval::sweep_csv(rows));
  write_text(folder / "summary.md", eval::sweep_table(rows, columns));
}

// Runs what is left, so many at a time.
class Runner {
 public:
  Runner(const config::Sweep& sweep, std::vector<Task>& tasks, const Arguments& a)
      : sweep_(sweep), tasks_(tasks), a_(a), program_(own_program()) {
    for (Task& task : tasks_) {
      if (task.row.state == SweepRow::State::open) waiting_.push_back(&task);
    }
  }

  /// False when it was interrupted.
  bool run(const InterruptGuard& guard) {
    while (!waiting_.empty() || !running_.empty()) {
      if (guard.interrupted()) {
        stop_all();
        return false;
      }
      while (!waiting_.empty() && running_.size() < static_cast<std::size_t>(a_.jobs)) start_next();
      gather();
      std::this_thread::sleep_for(kPollInterval);
    }
    return true;
  }

 private:
  struct Running {
    Task* task;
    ChildProcess process;
    Stopwatch watch;
  };

  void start_next() {
    Task& task = *waiting_.front();
    waiting_.pop_front();
    fs::remove(task.done);
    log::info("{}: begins", task.name);
    running_.push_back(
        {&task, ChildProcess(arguments_of(task, sweep_.file.command, program_), task.log), {}});
  }

  void gather() {
    for (auto it = running_.begin(); it != running_.end();) {
      const std::optional<ChildExit> exit = it->process.poll();
      if (!exit) {
        ++it;
        continue;
      }
      Task& task = *it->task;
      finish(task, *exit);
      if (exit->success()) {
        log::info("{}: done in {:.1f} s", task.name, it->watch.seconds());
      } else {
        log::warning("{}: {}; all it said is in {}", task.name, task.row.reason, task.log.string());
      }
      write_summary(tasks_, sweep_.file.columns, a_.folder);
      it = running_.erase(it);
    }
  }

  // What was under way has not finished, whatever it ends with.
  void stop_all() {
    log::warning("interrupted; {} cases under way are asked to stop", running_.size());
    for (Running& r : running_) r.process.stop();
    const Stopwatch watch;
    for (Running& r : running_) {
      while (!r.process.poll()) {
        if (watch.seconds() > kPatience_s) r.process.kill();
        std::this_thread::sleep_for(kPollInterval);
      }
    }
    running_.clear();
  }

  const config::Sweep& sweep_;
  std::vector<Task>& tasks_;
  const Arguments& a_;
  fs::path program_;
  std::list<Task*> waiting_;
  std::list<Running> running_;
};

std::size_t count(const std::vector<Task>& tasks, SweepRow::State state) {
  std::size_t n = 0;
  for (const Task& task : tasks) n += task.row.state == state ? 1 : 0;
  return n;
}

void run_sweep(Arguments a) {
  const config::Sweep sweep = config::load_sweep(a.sweep);
  if (a.folder.empty()) a.folder = fs::path("runs") / a.sweep.stem();
  std::vector<Task> tasks;
  for (const config::SweepCase& one : sweep.cases) {
    tasks.push_back(make_task(one, sweep.file.command, a.folder));
    Task& task = tasks.back();
    if (!is_finished(task, sweep.file.command)) continue;
    task.row.state = SweepRow::State::done;
    take_metrics(task);
  }
  const std::size_t before = count(tasks, SweepRow::State::done);
  log::info("{} cases, {} finished already", tasks.size(), before);
  const InterruptGuard guard;
  const bool complete = Runner(sweep, tasks, a).run(guard);
  write_summary(tasks, sweep.file.columns, a.folder);
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
  command->add_option("-j,--jobs", a->jobs, "cases at the same time")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  command->callback([a] { run_sweep(*a); });
}

}  // namespace apvi::apps
