// SPDX-License-Identifier: BSD-3-Clause
#include <exception>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "cli/configurations.hpp"
#include "cli/mapping_support.hpp"
#include "cli/report.hpp"
#include "cli/run_support.hpp"
#include "core/interrupt.hpp"
#include "runs/live/live_run.hpp"
#include "runs/run.hpp"
#include "runs/run_folder.hpp"

namespace apvi::cli {
namespace {

namespace fs = std::filesystem;

struct Arguments {
  std::vector<std::string> sources;
  std::vector<std::string> outputs;
  fs::path configuration = "default.yaml";
  fs::path rig;
  std::vector<std::string> overrides;
  fs::path folder;
  bool overwrite = false;
  bool no_report = false;
  ViewOptions view;
};

runs::RunConfig load_config(const Arguments& a) {
  runs::RunConfig config = runs::load_run_config(find_configuration(a.configuration), a.overrides,
                                                 configuration_folders());
  if (!a.sources.empty()) config.live.sources = a.sources;
  if (!a.outputs.empty()) config.live.outputs = a.outputs;
  if (!a.rig.empty()) config.dataset.rig = a.rig.string();
  if (!config.localization.enabled) fail_input("localization.enabled: must be true for apvi live");
  return config;
}

std::optional<runs::RunResult> localize(runs::LiveRun& live, const MappingRequest& request) {
  if (runs::makes_map(live.config(), live.sequence())) {
    return localize_and_map(live.config(), live.sequence(), request);
  }
  return runs::run(live.config(), live.sequence(),
                   {.folder = request.folder,
                    .overwrite = request.overwrite,
                    .interrupted = request.interrupted,
                    .live = request.live,
                    .observer = request.observer});
}

// The recording is kept whatever happens to the estimator.
void save_or_log(runs::LiveRun& live) {
  try {
    live.finish();
  } catch (const std::exception& e) {
    log::error("{}", e.what());
  }
}

void run(const Arguments& a) {
  const runs::RunConfig config = load_config(a);
  const fs::path folder = a.folder.empty() ? vacant_folder("live") : a.folder;
  runs::check_vacant(folder, a.overwrite);
  if (a.overwrite) fs::remove_all(folder / runs::kRecordingFolder);
  const InterruptGuard guard;
  const auto interrupted = [&guard] { return guard.interrupted(); };
  runs::LiveRun live(config, folder, interrupted);
  const auto observer = open_view(folder, a.view);
  const MappingRequest request{.folder = folder,
                               .overwrite = a.overwrite,
                               .interrupted = interrupted,
                               .live = &live.hooks(),
                               .observer = observer.get()};
  std::optional<runs::RunResult> result;
  try {
    result = localize(live, request);
  } catch (...) {
    save_or_log(live);
    throw;
  }
  live.finish();
  if (result) report(*result);
  if (!a.no_report && fs::exists(folder / "trajectory.tum")) write_report(folder);
  log::info("results in {}", folder.string());
}

void add_options(CLI::App& command, Arguments& a) {
  command
      .add_option("SOURCE", a.sources,
                  "waterlinked://HOST, mavlink://udp:PORT, rtsp://..., rtp+h264://:PORT, "
                  "v4l2:///dev/video0, video://FILE, or a recording (default: live.sources)")
      ->type_name("ADDRESS");
  command.add_option("--rig", a.rig, "calibration of the vehicle (rig.yaml)")->type_name("FILE");
  command
      .add_option("--out", a.outputs,
                  "where poses go: tum:PATH (file or named pipe), udp://HOST:PORT (JSON), "
                  "mavlink://udp:HOST:PORT; repeatable")
      ->type_name("OUTPUT")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  command.add_option("-c,--config", a.configuration, "configuration (default: default.yaml)")
      ->type_name("FILE");
  add_overrides(command, a.overrides,
                "override a configuration key, e.g. live.duration_s=60; repeatable");
  command.add_option("-o,--output", a.folder, "run folder (default: runs/live)")
      ->type_name("FOLDER");
  command.add_flag("--overwrite", a.overwrite, "replace an existing run in the folder");
  command.add_flag("--no-report", a.no_report, "do not write report.html");
  add_view_options(command, a.view);
}

}  // namespace

void add_live(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "live", "localize a vehicle in the water and, if it has a camera, map, into a run folder");
  add_options(*command, *a);
  command->footer("Ctrl-C ends the run; all results are saved, and the recording with them.");
  command->callback([a] { run(*a); });
}

}  // namespace apvi::cli
