// SPDX-License-Identifier: BSD-3-Clause
// Runs cases as elements of Slurm job arrays. An element runs the resolved configuration
// FOLDER/cases/NAME.job; it renames the file to NAME.done itself and writes its exit status to
// NAME.exit, so that elements count that end while no sweep is waiting. NAME.slurm holds the
// element's id.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <map>
#include <set>
#include <sstream>
#include <thread>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "cli/sweep_task.hpp"
#include "core/stopwatch.hpp"
#include "core/text.hpp"
#include "core/text_file.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;
using State = eval::SweepRow::State;

constexpr std::chrono::milliseconds kPollInterval{500};
constexpr double kExitFileTimeout_s =
    10.0;                                 // the exit file may appear late on a network file system
constexpr double kStopTimeout_s = 60.0;   // for elements being canceled
constexpr std::size_t kArraySize = 1000;  // below Slurm's default MaxArraySize of 1001

// Quotes a string for the shell.
std::string quoted(const std::string& text) {
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

struct CommandOutput {
  ChildExit exit;
  std::string text;  // standard output and error
};

CommandOutput run_command(const fs::path& folder, std::vector<std::string> command) {
  const fs::path output = folder / (command.front() + ".txt");
  command.insert(command.begin(), "/usr/bin/env");
  ChildProcess process(command, output);
  std::optional<ChildExit> exit;
  while (!(exit = process.poll())) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return {*exit, read_text(output)};
}

void require_success(const std::string& program, const CommandOutput& output) {
  if (output.exit.success()) return;
  if (output.exit.status == 127) {
    fail_input("--launcher slurm: {} not found; install slurm-client, or omit --launcher", program);
  }
  fail_run("{}: {}: {}", program, output.exit.text(), text::trim(output.text));
}

// "12_3": element 3 of job array 12.
std::string element_of(const SweepTask& task) {
  return std::string(text::trim(read_text(task.file(".slurm"))));
}

// Batch script of an array; each element runs one of `tasks`.
std::string batch_script(const std::vector<SweepTask*>& tasks) {
  std::string script =
      "#!/bin/bash\n# Cases of a sweep, one per element; written by apvi sweep.\ncases=(\n";
  for (const SweepTask* task : tasks) script += "  " + quoted(task->name) + "\n";
  const SweepTask& any = *tasks.front();
  const std::string name = "\"${cases[SLURM_ARRAY_TASK_ID]}\"";
  // FOLDER/cases/ of FOLDER/cases/NAME; NAME may contain slashes.
  const auto parent = [&](const fs::path& path) {
    const std::string text = fs::absolute(path).string();
    return quoted(text.substr(0, text.size() - any.name.size()));
  };
  script +=
      fmt::format(")\nstem={}{}\nfolder={}{}\n", parent(any.stem), name, parent(any.folder), name);
  const bool simulates = any.command == config::SweepFile::Command::sim;
  script += fmt::format(
      "{} {} \"$stem.job\" -o \"$folder\" {}> \"$stem.log\" 2>&1 < /dev/null\nstatus=$?\n"
      "if [[ $status == 0 ]]; then mv \"$stem.job\" \"$stem.done\"; fi\n"
      "echo $status > \"$stem.exit.new\" && mv \"$stem.exit.new\" \"$stem.exit\"\nexit $status\n",
      quoted(current_executable().string()), simulates ? "sim" : "run",
      simulates ? "" : "--overwrite ");
  return script;
}

// States ("COMPLETED", "TIMEOUT", ...) of the elements known to Slurm, by element id "12_3".
using ElementStates = std::map<std::string, std::string>;

// Empty when Slurm no longer knows the element. An array that never started is listed as "12_N/A".
std::string state_of(const std::string& element, const ElementStates& elements) {
  const std::string array = element.substr(0, element.find('_'));
  for (const std::string& name : {element, array + "_N/A"}) {
    if (const auto it = elements.find(name); it != elements.end()) return it->second;
  }
  return "";
}

bool is_active(const std::string& state) {
  static const std::set<std::string> active{"PENDING",   "RUNNING",   "CONFIGURING", "COMPLETING",
                                            "REQUEUED",  "SUSPENDED", "RESIZING",    "STOPPED",
                                            "SIGNALING", "STAGE_OUT", "REQUEUE_HOLD"};
  return active.contains(state);
}

class Cluster {
 public:
  explicit Cluster(const SweepLaunch& launch) : launch_(launch), folder_(launch.folder / "slurm") {
    fs::create_directories(folder_);
  }

  /// Finds elements that are still pending or running from an earlier call of this sweep. Throws
  /// RunError when such an element has a different configuration.
  void find_active() {
    const ElementStates elements = query_elements();
    for (SweepTask& task : launch_.tasks) {
      const std::string element = element_of(task);
      if (!is_active(state_of(element, elements))) continue;
      if (read_text(task.file(".job")) != task.identity) {
        fail_run("{} is active as Slurm job {} with other settings: wait for it, or scancel it",
                 task.name, element);
      }
      if (task.row.state != State::open) continue;
      log::info("{}: active as Slurm job {}", task.name, element);
      active_.push_back({&task, element, {}});
    }
  }

  void submit_remaining() {
    std::vector<SweepTask*> rest;
    for (SweepTask& task : launch_.tasks) {
      const auto is_this = [&](const ActiveElement& w) { return w.task == &task; };
      const bool watched = std::any_of(active_.begin(), active_.end(), is_this);
      if (task.row.state == State::open && !watched) rest.push_back(&task);
    }
    std::string before;
    for (std::size_t first = 0; first < rest.size(); first += kArraySize) {
      const std::size_t last = std::min(first + kArraySize, rest.size());
      before = submit({rest.begin() + static_cast<std::ptrdiff_t>(first),
                       rest.begin() + static_cast<std::ptrdiff_t>(last)},
                      before);
    }
  }

  /// Returns false when interrupted.
  bool wait_for_all(const InterruptGuard& guard) {
    while (!active_.empty()) {
      if (guard.interrupted()) {
        cancel();
        return false;
      }
      const ElementStates elements = query_elements();
      const auto ended = [&](ActiveElement& w) { return has_ended(w, elements); };
      if (std::erase_if(active_, ended) > 0) launch_.changed();
      if (!active_.empty()) std::this_thread::sleep_for(kPollInterval);
    }
    return true;
  }

 private:
  struct ActiveElement {
    SweepTask* task;
    std::string element;
    std::optional<Stopwatch> since_exit;
  };

  // Submits an array of these tasks and returns its Slurm id. It starts after the array `before`,
  // if any, so that the limit on parallel tasks holds.
  std::string submit(const std::vector<SweepTask*>& tasks, const std::string& before) {
    for (const SweepTask* task : tasks) {
      for (const char* ending : {".done", ".exit", ".slurm"}) fs::remove(task->file(ending));
      write_text(task->file(".job"), task->identity);
    }
    const fs::path script = folder_ / "array.sh";
    write_text(script, batch_script(tasks));
    std::string array = fmt::format("--array=0-{}", tasks.size() - 1);
    if (launch_.jobs > 0) array += fmt::format("%{}", launch_.jobs);
    std::vector<std::string> command{"sbatch", "--parsable", "--output=/dev/null", array,
                                     "--job-name=apvi-" + launch_.folder.filename().string()};
    if (!before.empty()) command.push_back("--dependency=afterany:" + before);
    command.insert(command.end(), launch_.sbatch.begin(), launch_.sbatch.end());
    command.push_back(script.string());
    const CommandOutput output = run_command(folder_, command);
    require_success("sbatch", output);
    std::string id(text::trim(output.text.substr(0, output.text.find(';'))));
    if (id.empty() || id.find_first_not_of("0123456789") != std::string::npos) {
      fail_run("sbatch: expected a job number, got \"{}\"", text::trim(output.text));
    }
    for (std::size_t i = 0; i < tasks.size(); ++i) {
      const std::string element = fmt::format("{}_{}", id, i);
      write_text(tasks[i]->file(".slurm"), element + "\n");
      active_.push_back({tasks[i], element, {}});
    }
    log::info("{} cases submitted as Slurm job array {}", tasks.size(), id);
    return id;
  }

  // Queries all jobs of this user, so that an id unknown to Slurm is no error.
  ElementStates query_elements() {
    const CommandOutput output = run_command(
        folder_, {"squeue", "--me", "--noheader", "--array", "--states=all", "--format=%F_%K %T"});
    // The controller may be unavailable for a moment: use the previous states.
    if (!output.exit.success() && !last_states_.empty()) return last_states_;
    require_success("squeue", output);
    ElementStates elements;
    std::istringstream in(output.text);
    for (std::string element, state; in >> element >> state;) elements[element] = state;
    last_states_ = elements;
    return elements;
  }

  static bool has_ended(ActiveElement& w, const ElementStates& elements) {
    SweepTask& task = *w.task;
    if (const std::string exit_text(text::trim(read_text(task.file(".exit"))));
        !exit_text.empty()) {
      int status = 1;
      std::from_chars(exit_text.data(), exit_text.data() + exit_text.size(), status);
      finish(task, status > 128 ? ChildExit{0, status - 128} : ChildExit{status, 0});
      if (task.row.state == State::done) log::info("{}: done", task.name);
      return true;
    }
    const std::string state = state_of(w.element, elements);
    if (is_active(state)) {
      w.since_exit.reset();
      return false;
    }
    if (!w.since_exit) w.since_exit.emplace();
    if (w.since_exit->seconds() < kExitFileTimeout_s) return false;
    fail_task(task, fmt::format("Slurm job {}: {}, without an exit status", w.element,
                                state.empty() ? "no longer known to Slurm" : state));
    return true;
  }

  // Canceled elements stay unfinished, whatever their exit status.
  void cancel() {
    log::warning("interrupted; canceling {} Slurm jobs", active_.size());
    std::set<std::string> jobs;
    for (const ActiveElement& w : active_) jobs.insert(w.element.substr(0, w.element.find('_')));
    std::vector<std::string> command{"scancel"};
    command.insert(command.end(), jobs.begin(), jobs.end());
    require_success("scancel", run_command(folder_, command));
    const Stopwatch watch;
    while (!active_.empty() && watch.seconds() < kStopTimeout_s) {
      const ElementStates elements = query_elements();
      std::erase_if(active_, [&](const ActiveElement& w) {
        return !is_active(state_of(w.element, elements));
      });
      std::this_thread::sleep_for(kPollInterval);
    }
  }

  const SweepLaunch& launch_;
  fs::path folder_;
  std::vector<ActiveElement> active_;
  ElementStates last_states_;
};

}  // namespace

bool run_on_slurm(const SweepLaunch& launch, const InterruptGuard& guard) {
  Cluster cluster(launch);
  cluster.find_active();
  cluster.submit_remaining();
  launch.changed();
  return cluster.wait_for_all(guard);
}

}  // namespace apvi::cli
