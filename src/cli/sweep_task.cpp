// SPDX-License-Identifier: BSD-3-Clause
#include "cli/sweep_task.hpp"

#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "cli/configurations.hpp"
#include "cli/mapping_support.hpp"
#include "core/atomic_file.hpp"
#include "core/text_file.hpp"
#include "sim/scene_config.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;
using Command = config::SweepFile::Command;
using State = eval::SweepRow::State;

void check_case(const fs::path& file, Command command) {
  if (command == Command::sim) {
    sim::load_scene(file, {}, configuration_folders());
  } else {
    runs::load_run_config(file, {}, configuration_folders());
  }
}

void load_metrics(SweepTask& task) {
  const fs::path file = task.folder / "metrics.json";
  if (fs::exists(file)) task.row.metrics = eval::flatten(eval::read_metrics(file));
}

}  // namespace

void write_text(const fs::path& file, const std::string& text) {
  write_file_atomically(file, [&](std::ostream& out) { out << text; });
}

SweepTask make_task(const config::SweepCase& of, Command command, const fs::path& folder) {
  SweepTask task;
  task.command = command;
  task.name = of.folder().string();
  task.stem = folder / "cases" / of.folder();
  task.folder = folder / of.folder();
  fs::create_directories(task.stem.parent_path());
  write_text(task.file(".yaml"), config::to_yaml(of.config));
  check_case(task.file(".yaml"), command);
  const config::Node complete =
      config::load_with_inheritance(task.file(".yaml"), {}, configuration_folders());
  task.identity =
      (command == Command::sim ? "# apvi sim\n" : "# apvi run\n") + config::to_yaml(complete);
  task.row.group = of.group;
  task.row.choices = of.choices;
  task.row.seed = of.seed;
  return task;
}

bool load_if_finished(SweepTask& task) {
  const fs::path product =
      task.command == Command::sim ? task.folder : task.folder / "metrics.json";
  if (!fs::exists(product) || read_text(task.file(".done")) != task.identity) return false;
  task.row.state = State::done;
  load_metrics(task);
  return true;
}

std::vector<std::string> arguments_of(const SweepTask& task, const fs::path& configuration) {
  std::vector<std::string> arguments{current_executable().string(),
                                     task.command == Command::sim ? "sim" : "run",
                                     configuration.string(), "-o", task.folder.string()};
  if (task.command == Command::run) {
    arguments.insert(arguments.end(), {"--overwrite", "--no-report"});
  }
  return arguments;
}

void finish(SweepTask& task, const ChildExit& exit) {
  if (!exit.success()) {
    const std::string reason = last_line(task.file(".log"));
    fail_task(task, reason.empty() ? exit.text() : fmt::format("{}: {}", exit.text(), reason));
    return;
  }
  task.row.state = State::done;
  write_text(task.file(".done"), task.identity);
  load_metrics(task);
}

void fail_task(SweepTask& task, const std::string& reason) {
  task.row.state = State::failed;
  task.row.reason = reason;
  log::warning("{}: {}; see {}", task.name, reason, task.file(".log").string());
}

}  // namespace apvi::cli
