// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "apvi/config/fields.hpp"
#include "apvi/config/node.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/interrupt.hpp"
#include "apvi/core/log.hpp"
#include "apvi/core/progress.hpp"
#include "apvi/doctor/doctor.hpp"
#include "commands.hpp"

namespace apvi::apps {
namespace {

struct Arguments {
  std::string dataset;
  std::string rig;
  std::vector<std::string> overrides;
  bool json = false;
};

io::DatasetConfig dataset_of(const Arguments& a) {
  config::Node node;
  for (const std::string& assignment : a.overrides) config::apply_override(node, assignment);
  io::DatasetConfig dataset;
  if (!node.is_null()) config::read(node, dataset, "dataset");
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
  if (errors > 0) fail_run("{}: {} of the findings are errors", a.dataset, errors);
}

}  // namespace

void add_doctor(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "doctor", "what is wrong with a recording or its calibration, and what to do about it");
  command->add_option("DATASET", a->dataset, "folder or .bag file")->required();
  command->add_option("--rig", a->rig, "calibration file instead of the data set's own")
      ->type_name("FILE");
  command
      ->add_option("--set", a->overrides,
                   "a key of the dataset section: topics.imu=/imu/data, start_s=60, "
                   "pressure_unit=hPa; may be repeated")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  command->add_flag("--json", a->json, "print JSON instead of a list");
  command->footer(
      "Checks rates, gaps, jitter and order of stamps; units, signs and sizes; DVL validity, "
      "beams,\n"
      "time offset, lever arm and mounting against IMU, depth and reference; image sizes.\n"
      "Status: 0 no errors (warnings are not errors), 1 some finding is an error, 2 nothing of "
      "the\n"
      "recording can be opened.");
  command->callback([a] { run(*a); });
}

}  // namespace apvi::apps
