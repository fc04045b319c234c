// SPDX-License-Identifier: BSD-3-Clause
#include <memory>

#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "cli/report.hpp"
#include "core/interrupt.hpp"
#include "runs/diff/diff_run.hpp"

namespace apvi::cli {
namespace {

struct Arguments {
  runs::DiffRequest request;
  bool report = true;
};

void diff(const Arguments& a) {
  const InterruptGuard guard;
  runs::DiffRequest request = a.request;
  request.interrupted = [&guard] { return guard.interrupted(); };
  const runs::DiffSummary found = runs::diff_runs(request);
  log::info(
      "{} appeared, {} vanished, {} of another color on {:.4g} m²; {:.4g} m² not seen in both",
      found.appeared, found.vanished, found.color, found.compared_m2, found.unknown_m2);
  log::info("changes in {}", request.out.string());
  if (a.report) write_report(request.out);
}

}  // namespace

void add_diff(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  runs::DiffRequest& r = a->request;
  CLI::App* command =
      app.add_subcommand("diff", "list what has changed between the maps of two dives");
  command->add_option("RUN1", r.before, "run folder of the earlier dive")
      ->type_name("FOLDER")
      ->required();
  command
      ->add_option("RUN2", r.after, "run folder of the later dive, as of apvi run DIVE2 --map RUN1")
      ->type_name("FOLDER")
      ->required();
  command->add_option("-o,--output", r.out, "output folder")->type_name("FOLDER")->required();
  command
      ->add_option("--min-size", r.options.min_size_m,
                   "length of the smallest change to list [m]; default: 0.1")
      ->check(CLI::PositiveNumber)
      ->type_name("METERS");
  command
      ->add_option("--cell", r.options.cell_m,
                   "edge of the cells that are compared [m]; default: a quarter of --min-size")
      ->check(CLI::PositiveNumber)
      ->type_name("METERS");
  command->add_flag("--same-frame", r.same_frame,
                    "do not check that the runs have the same coordinates");
  command->add_flag("--overwrite", r.overwrite, "replace an earlier change map");
  command->add_flag_callback(
      "--no-report", [a] { a->report = false; }, "do not write report.html");
  command->callback([a] { diff(*a); });
}

}  // namespace apvi::cli
