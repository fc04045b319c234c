// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "config/renamed_keys.hpp"
#include "core/interrupt.hpp"
#include "core/status_line.hpp"
#include "doctor/doctor.hpp"

namespace apvi::cli {
namespace {

struct Arguments {
  std::string dataset;
  std::string rig;
  std::vector<std::string> overrides;
  bool json = false;
};

io::DatasetConfig dataset_of(const Arguments& a) {
  config::Node root;
  config::Node& section = root.member("dataset");
  for (const std::string& assignment : a.overrides) config::apply_override(section, assignment);
  config::KeyRenamer(config::run_renames()).apply(root);
  io::DatasetConfig dataset;
  config::read(root.member("dataset"), dataset, "dataset");
  dataset.path = a.dataset;
  if (!a.rig.empty()) dataset.rig = a.rig;
  return dataset;
}

doctor::Report examine(const Arguments& a) {
  const InterruptGuard guard;
  StatusLine status("reading");
  const doctor::Options options{.progress = [&](double f) { status.update(f, ""); },
                                .interrupted = [&] { return guard.interrupted(); }};
  return doctor::examine(dataset_of(a), options);
}

void run(const Arguments& a) {
  const doctor::Report report = examine(a);
  const std::string text = a.json ? doctor::to_json(report) : doctor::to_text(report);
  if (std::fputs(text.c_str(), stdout) < 0 || std::fflush(stdout) != 0) {
    fail_run("standard output: cannot be written");
  }
  const std::size_t errors = report.count(doctor::Severity::error);
  if (errors > 0) fail_run("{}: {} findings are errors", a.dataset, errors);
}

}  // namespace

void add_doctor(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command =
      app.add_subcommand("doctor", "diagnose problems of a recording or its calibration");
  command->add_option("DATASET", a->dataset, "folder, or .bag, .mcap or .db3 file")
      ->type_name("FILE|FOLDER")
      ->required();
  command->add_option("--rig", a->rig, "calibration file to use instead of the dataset's own")
      ->type_name("FILE");
  command
      ->add_option("--set", a->overrides,
                   "override a key of the dataset section, e.g. topics.imu=/imu/data, start_s=60, "
                   "pressure_unit=hPa; repeatable")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  command->add_flag("--json", a->json, "print JSON instead of text");
  command->footer(
      "Checks rates, gaps, jitter and order of stamps; units, signs and ranges; DVL validity and\n"
      "beams; DVL time offset, lever arm and mounting against IMU, depth and reference; image "
      "sizes.\n"
      "Exit status: 0 no errors (warnings are not errors), 1 at least one error, 2 the recording\n"
      "cannot be opened.");
  command->callback([a] { run(*a); });
}

}  // namespace apvi::cli
