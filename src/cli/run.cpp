// SPDX-License-Identifier: BSD-3-Clause
#include <chrono>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "cli/mapping_support.hpp"
#include "core/interrupt.hpp"
#include "eval/metrics_file.hpp"
#include "runs/run.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  fs::path config;
  std::vector<std::string> overrides;
  fs::path folder;
  bool overwrite = false;
  bool resume = false;
};

// runs/<configuration>-<dataset>, with a numeric suffix when that folder exists.
fs::path default_folder(const Arguments& a, const runs::RunConfig& config) {
  const fs::path data = fs::path(config.dataset.path).lexically_normal();
  const std::string name =
      data.has_filename() ? data.stem().string() : data.parent_path().filename().string();
  const std::string base = a.config.stem().string() + "-" + name;
  fs::path folder = fs::path("runs") / base;
  for (int i = 2; fs::exists(folder); ++i)
    folder = fs::path("runs") / fmt::format("{}-{}", base, i);
  return folder;
}

void report(const runs::RunResult& result) {
  if (result.interrupted) log::warning("interrupted; results so far are saved");
  log::info("{} poses of {:.1f} s in {:.2f} s ({:.0f} times real time)", result.poses,
            result.sequence_s, result.wall_s, result.sequence_s / std::max(1e-9, result.wall_s));
  std::fputs(eval::to_table(result.metrics).c_str(), stdout);
}

void run(const Arguments& a) {
  const runs::RunConfig config = runs::load_run_config(a.config, a.overrides);
  const InterruptGuard guard;
  const auto interrupted = [&guard] { return guard.interrupted(); };
  const fs::path folder = a.folder.empty() ? default_folder(a, config) : a.folder;
  const MappingRequest map{
      .folder = folder, .overwrite = a.overwrite, .resume = a.resume, .interrupted = interrupted};
  if (!config.localization.enabled) return make_map(config, map);
  if (config.mapping.enabled) {
    if (const auto result = localize_and_map(config, map)) report(*result);
    return;
  }
  report(
      runs::run(config, {.folder = folder, .overwrite = a.overwrite, .interrupted = interrupted}));
  log::info("results in {}", folder.string());
}

}  // namespace

void add_run(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "run", "run localization, mapping or both on a recording, into a run folder");
  command->add_option("CONFIG", a->config, "configuration file, for example configs/default.yaml")
      ->required();
  command
      ->add_option("--set", a->overrides,
                   "override a configuration key, e.g. dataset.path=FOLDER; repeatable")
      ->type_name("KEY=VALUE")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  command->add_option("-o,--output", a->folder, "run folder (default: runs/CONFIG-DATASET)");
  command->add_flag("--overwrite", a->overwrite, "replace an existing run in the folder");
  command->add_flag("--resume", a->resume, "resume the folder's map from its checkpoint");
  command->callback([a] { run(*a); });
}

}  // namespace apvi::cli
