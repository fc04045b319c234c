// SPDX-License-Identifier: BSD-3-Clause
#include "runs/calibrate/calibrate.hpp"

#include <cstdio>
#include <map>
#include <memory>

#include "apvi/core/log.hpp"
#include "cli/calibrate_rig.hpp"
#include "cli/commands.hpp"
#include "cli/configurations.hpp"
#include "cli/run_support.hpp"
#include "core/interrupt.hpp"

namespace apvi::cli {
namespace {

using runs::CalibrateOptions;

void calibrate(CalibrateOptions& options) {
  const InterruptGuard guard;
  if (!options.config.empty()) options.config = find_configuration(options.config);
  options.search = configuration_folders();
  options.interrupted = [&guard] { return guard.interrupted(); };
  const runs::CalibrationResult result = runs::calibrate(options);
  std::fputs(runs::to_table(result).c_str(), stdout);
  log::info("thresholds written to {}; plot the fit with scripts/plot_calibration.py {}",
            (options.folder / "thresholds.yaml").string(), options.folder.string());
}

}  // namespace

void add_calibrate(CLI::App& app) {
  const auto a = std::make_shared<CalibrateOptions>();
  a->folder = "runs/calibration";
  CLI::App* command = app.add_subcommand(
      "calibrate",
      "find the thresholds of the degeneracy check from recordings with good vision; or, as "
      "calibrate rig, the calibration of a vehicle");
  command
      ->add_option("RECORDING|RUN", a->inputs,
                   "recordings to run, or folders of finished runs with `vio.graph: paper`")
      ->type_name("FILE|FOLDER");
  command->add_option("-c,--config", a->config, "run configuration for recordings")
      ->type_name("FILE");
  add_overrides(*command, a->overrides, "override a configuration key; repeatable");
  command->add_option("-o,--output", a->folder, "output folder")
      ->type_name("FOLDER")
      ->capture_default_str();
  command->add_flag("--overwrite", a->overwrite, "replace existing runs in the folder");
  command
      ->add_option("--normalization", a->normalization, "normalization of the written thresholds")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, fusion::Normalization>{
              {"none", fusion::Normalization::none},
              {"per_inlier", fusion::Normalization::per_inlier}},
          CLI::ignore_case));
  command
      ->add_option("--false-alarm", a->max_false_alarm,
                   "maximum fraction of healthy frames rejected")
      ->check(CLI::Range(0.0, 0.5))
      ->type_name("FRACTION")
      ->capture_default_str();
  add_calibrate_rig(*command);
  command->callback([a, command] {
    if (command->get_subcommands().empty()) calibrate(*a);
  });
}

}  // namespace apvi::cli
