// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/pipeline/calibrate.hpp"

#include <cstdio>
#include <map>
#include <memory>

#include "apvi/core/interrupt.hpp"
#include "apvi/core/log.hpp"
#include "commands.hpp"

namespace apvi::apps {
namespace {

using pipeline::CalibrateOptions;

void calibrate(CalibrateOptions& options) {
  const InterruptGuard guard;
  options.interrupted = [&guard] { return guard.interrupted(); };
  const pipeline::CalibrationResult result = pipeline::calibrate(options);
  std::fputs(pipeline::to_table(result).c_str(), stdout);
  log::info("thresholds in {}; scripts/plot_calibration.py {} draws the fit",
            (options.folder / "thresholds.yaml").string(), options.folder.string());
}

}  // namespace

void add_calibrate(CLI::App& app) {
  const auto a = std::make_shared<CalibrateOptions>();
  a->folder = "runs/calibration";
  CLI::App* command = app.add_subcommand(
      "calibrate", "thresholds of the discriminator's last step, from recordings with good vision");
  command
      ->add_option("RECORDING|RUN", a->inputs,
                   "recordings to run, or folders of runs with `vio.graph: paper`")
      ->required();
  command->add_option("-c,--config", a->config, "configuration that recordings are run with");
  command->add_option("--set", a->overrides, "override a key of it; may be repeated")
      ->type_name("KEY=VALUE")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  command->add_option("-o,--output", a->folder, "folder for all of it")->capture_default_str();
  command->add_flag("--overwrite", a->overwrite, "replace runs that the folder holds");
  command->add_option("--normalisation", a->normalisation, "of the thresholds that are written")
      ->transform(CLI::CheckedTransformer(
          std::map<std::string, fusion::Normalisation>{
              {"none", fusion::Normalisation::none},
              {"per_inlier", fusion::Normalisation::per_inlier}},
          CLI::ignore_case));
  command
      ->add_option("--false-alarm", a->max_false_alarm, "share of healthy frames rejected at most")
      ->check(CLI::Range(0.0, 0.5))
      ->capture_default_str();
  command->callback([a] { calibrate(*a); });
}

}  // namespace apvi::apps
