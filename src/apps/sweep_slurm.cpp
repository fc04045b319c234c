// SPDX-License-Identifier: BSD-3-Clause
// Cases as elements of Slurm job arrays. What an element runs, FOLDER/cases/NAME.job, is the
// configuration in full; the element itself renames it to NAME.done and writes its exit status to
// NAME.exit, so that what ends while nobody gathers counts as well. NAME.slurm names the element.
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
#include "apvi/core/stopwatch.hpp"
#include "apvi/core/text.hpp"
#include "sweep_task.hpp"

namespace apvi::apps {
namespace {

namespace fs = std::filesystem;
using State = eval::SweepRow::State;

constexpr std::chrono::milliseconds kPollInterval{500};
constexpr double kGrace_s = 10.0;  // a status may come later than the end, over a network's disks
constexpr double kPatience_s = 60.0;      // for elements that were asked to stop
constexpr std::size_t kArraySize = 1000;  // Slurm's MaxArraySize is 1001 unless its owner says more

// In single quotes, for a shell.
std::string quoted(const std::string& text) {
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

struct Answer {
  ChildExit exit;
  std::string text;  // both outputs
};

Answer ask(const fs::path& folder, std::vector<std::string> command) {
  const fs::path output = folder / (command.front() + ".txt");
  command.insert(command.begin(), "/usr/bin/env");
  ChildProcess process(command, output);
  std::optional<ChildExit> exit;
  while (!(exit = process.poll())) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return {*exit, read_text(output)};
}

void expect_success(const std::string& program, const Answer& answer) {
  if (answer.exit.success()) return;
  if (answer.exit.status == 127) {
    fail_input("--launcher slurm: {} is not there; install slurm-client, or leave --launcher out",
               program);
  }
  fail_run("{}: {}: {}", program, answer.exit.text(), text::trim(answer.text));
}

// "12_3": element 3 of job array 12.
std::string element_of(const SweepTask& task) {
  return std::string(text::trim(read_text(task.file(".slurm"))));
}

// What an element of the array does: one case of those in `tasks`.
std::string batch_script(const std::vector<SweepTask*>& tasks) {
  std::string script =
      "#!/bin/bash\n# Cases of a sweep, one an element; written by apvi sweep.\ncases=(\n";
  for (const SweepTask* task : tasks) script += "  " + quoted(task->name) + "\n";
  const SweepTask& any = *tasks.front();
  const std::string name = "\"${cases[SLURM_ARRAY_TASK_ID]}\"";
  // FOLDER/cases/NAME without NAME, whatever slashes are in it.
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
      quoted(own_program().string()), simulates ? "sim" : "run", simulates ? "" : "--overwrite ");
  return script;
}

// "COMPLETED", "TIMEOUT" and so on of elements that Slurm still knows, by "12_3".
using Elements = std::map<std::string, std::string>;

// Empty for one that it does not know any more. An array that never began is one line, "12_N/A".
std::string state_of(const std::string& element, const Elements& elements) {
  const std::string array = element.substr(0, element.find('_'));
  for (const std::string& name : {element, array + "_N/A"}) {
    if (const auto it = elements.find(name); it != elements.end()) return it->second;
  }
  return "";
}

bool is_under_way(const std::string& state) {
  static const std::set<std::string> under_way{
      "PENDING",  "RUNNING", "CONFIGURING", "COMPLETING", "REQUEUED",    "SUSPENDED",
      "RESIZING", "STOPPED", "SIGNALING",   "STAGE_OUT",  "REQUEUE_HOLD"};
  return under_way.contains(state);
}

class Cluster {
 public:
  explicit Cluster(const SweepLaunch& launch) : launch_(launch), folder_(launch.folder / "slurm") {
    fs::create_directories(folder_);
  }

  /// Those that are waiting or running for a sweep that was left; what others a restart finds are
  /// to be submitted. Throws RunError when what is under way would give something else.
  void find_what_is_under_way() {
    const Elements elements = ask_for_elements();
    for (SweepTask& task : launch_.tasks) {
      const std::string element = element_of(task);
      if (!is_under_way(state_of(element, elements))) continue;
      if (read_text(task.file(".job")) != task.identity) {
        fail_run("{} is under way as Slurm's {} with other settings: wait for it, or scancel it",
                 task.name, element);
      }
      if (task.row.state != State::open) continue;
      log::info("{}: under way as Slurm's {}", task.name, element);
      watched_.push_back({&task, element, {}});
    }
  }

  void submit_the_rest() {
    std::vector<SweepTask*> rest;
    for (SweepTask& task : launch_.tasks) {
      const auto is_this = [&](const Watched& w) { return w.task == &task; };
      const bool watched = std::any_of(watched_.begin(), watched_.end(), is_this);
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

  /// False when it was interrupted.
  bool gather(const InterruptGuard& guard) {
    while (!watched_.empty()) {
      if (guard.interrupted()) {
        cancel();
        return false;
      }
      const Elements elements = ask_for_elements();
      const auto ended = [&](Watched& w) { return has_ended(w, elements); };
      if (std::erase_if(watched_, ended) > 0) launch_.changed();
      if (!watched_.empty()) std::this_thread::sleep_for(kPollInterval);
    }
    return true;
  }

 private:
  struct Watched {
    SweepTask* task;
    std::string element;
    std::optional<Stopwatch> since_end;
  };

  // An array of these; the id that Slurm gave it. It begins after the array `before`, if any, so
  // that no more run at the same time than were allowed.
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
    const Answer answer = ask(folder_, command);
    expect_success("sbatch", answer);
    std::string id(text::trim(answer.text.substr(0, answer.text.find(';'))));
    if (id.empty() || id.find_first_not_of("0123456789") != std::string::npos) {
      fail_run("sbatch: said \"{}\" where a job's number was expected", text::trim(answer.text));
    }
    for (std::size_t i = 0; i < tasks.size(); ++i) {
      const std::string element = fmt::format("{}_{}", id, i);
      write_text(tasks[i]->file(".slurm"), element + "\n");
      watched_.push_back({tasks[i], element, {}});
    }
    log::info("{} cases submitted as Slurm's job array {}", tasks.size(), id);
    return id;
  }

  // Asks for this user's jobs, so that a number that Slurm has forgotten is no error.
  Elements ask_for_elements() {
    const Answer answer = ask(
        folder_, {"squeue", "--me", "--noheader", "--array", "--states=all", "--format=%F_%K %T"});
    // A controller that is away for a moment knows everything again when it is back.
    if (!answer.exit.success() && !last_answer_.empty()) return last_answer_;
    expect_success("squeue", answer);
    Elements elements;
    std::istringstream in(answer.text);
    for (std::string element, state; in >> element >> state;) elements[element] = state;
    last_answer_ = elements;
    return elements;
  }

  static bool has_ended(Watched& w, const Elements& elements) {
    SweepTask& task = *w.task;
    if (const std::string said(text::trim(read_text(task.file(".exit")))); !said.empty()) {
      int status = 1;
      std::from_chars(said.data(), said.data() + said.size(), status);
      finish(task, status > 128 ? ChildExit{0, status - 128} : ChildExit{status, 0});
      if (task.row.state == State::done) log::info("{}: done", task.name);
      return true;
    }
    const std::string state = state_of(w.element, elements);
    if (is_under_way(state)) {
      w.since_end.reset();
      return false;
    }
    if (!w.since_end) w.since_end.emplace();
    if (w.since_end->seconds() < kGrace_s) return false;
    fail_task(task, fmt::format("Slurm's {}: {}, without an exit status", w.element,
                                state.empty() ? "no longer known to it" : state));
    return true;
  }

  // What is under way has not finished, whatever it ends with.
  void cancel() {
    log::warning("interrupted; {} cases are taken back from Slurm", watched_.size());
    std::set<std::string> jobs;
    for (const Watched& w : watched_) jobs.insert(w.element.substr(0, w.element.find('_')));
    std::vector<std::string> command{"scancel"};
    command.insert(command.end(), jobs.begin(), jobs.end());
    expect_success("scancel", ask(folder_, command));
    const Stopwatch watch;
    while (!watched_.empty() && watch.seconds() < kPatience_s) {
      const Elements elements = ask_for_elements();
      std::erase_if(watched_,
                    [&](const Watched& w) { return !is_under_way(state_of(w.element, elements)); });
      std::this_thread::sleep_for(kPollInterval);
    }
  }

  const SweepLaunch& launch_;
  fs::path folder_;
  std::vector<Watched> watched_;
  Elements last_answer_;
};

}  // namespace

bool run_on_slurm(const SweepLaunch& launch, const InterruptGuard& guard) {
  Cluster cluster(launch);
  cluster.find_what_is_under_way();
  cluster.submit_the_rest();
  launch.changed();
  return cluster.gather(guard);
}

}  // namespace apvi::apps
