// SPDX-License-Identifier: BSD-3-Clause
#include "cli/calibrate_rig.hpp"

#include <cstdio>
#include <filesystem>
#include <memory>

#include "apvi/core/log.hpp"
#include "cli/configurations.hpp"
#include "cli/run_support.hpp"
#include "core/interrupt.hpp"
#include "runs/calibrate/rig_calibration.hpp"

namespace apvi::cli {
namespace {

using runs::RigCalibrationOptions;

void calibrate_rig(RigCalibrationOptions& options) {
  const InterruptGuard guard;
  options.config = find_configuration(options.config);
  options.search = configuration_folders();
  options.interrupted = [&guard] { return guard.interrupted(); };
  const runs::RigCalibration found = runs::calibrate_rig(options);
  std::fputs(runs::to_table(found).c_str(), stdout);
  if (!found.settled) {
    log::warning(
        "the calibration still moves by more than its sigma after {} rounds: repeat with "
        "--rig {}",
        found.rounds, options.output.string());
  }
  log::info("rig written to {}", options.output.string());
}

}  // namespace

void add_calibrate_rig(CLI::App& calibrate) {
  const auto a = std::make_shared<RigCalibrationOptions>();
  a->config = "localization.yaml";
  CLI::App* command =
      calibrate.add_subcommand("rig", "refine the calibration of a vehicle over several dives");
  command->add_option("DIVE", a->dives, "recordings")->type_name("FILE|FOLDER")->required();
  command->add_option("--rig", a->rig, "rig to start from (default: that of the recordings)")
      ->type_name("FILE");
  command->add_option("-o,--output", a->output, "rig.yaml to write")->type_name("FILE")->required();
  command->add_option("-c,--config", a->config, "run configuration")
      ->type_name("FILE")
      ->capture_default_str();
  add_overrides(*command, a->overrides, "override a configuration key; repeatable");
  command->add_option("--runs", a->runs, "keep the runs in this folder")->type_name("FOLDER");
  command->callback([a] { calibrate_rig(*a); });
}

}  // namespace apvi::cli
