// SPDX-License-Identifier: BSD-3-Clause
#include "runs/merge/merge_run.hpp"

#include <cmath>
#include <memory>

#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "core/interrupt.hpp"

namespace apvi::cli {
namespace {

void merge(runs::MergeRequest request) {
  const InterruptGuard guard;
  request.interrupted = [&guard] { return guard.interrupted(); };
  const runs::MergeResult result = runs::merge_runs(request);
  if (result.interrupted) {
    log::warning("interrupted; results so far are saved, --resume continues from them");
  }
  log::info("{} Gaussians after {} iterations, {:.0f} s in total", result.gaussians,
            result.iterations, result.wall_s);
  for (std::size_t i = 0; i < result.psnr_db.size(); ++i) {
    if (std::isnan(result.psnr_db[i])) continue;
    log::info("{:.2f} dB PSNR on held-out images of {}", result.psnr_db[i],
              request.runs[i].string());
  }
}

}  // namespace

void add_merge(CLI::App& app) {
  const auto r = std::make_shared<runs::MergeRequest>();
  CLI::App* command =
      app.add_subcommand("merge", "join the maps of several dives at one place into one map");
  command->add_option("RUN", r->runs, "run folders with maps; the first one's frame is kept")
      ->expected(2, -1)
      ->type_name("FOLDER")
      ->required();
  command
      ->add_option("--iterations", r->iterations,
                   "of the joint optimization; default: ten for every training image")
      ->check(CLI::PositiveNumber)
      ->type_name("N");
  command->add_option("--threads", r->threads, "of the CPU; default: as the first run")
      ->check(CLI::PositiveNumber)
      ->type_name("N");
  command->add_flag("--same-frame", r->same_frame,
                    "the runs are in one frame: do not look for common places");
  command->add_option("-o,--output", r->folder, "folder of the merged map")
      ->type_name("FOLDER")
      ->required();
  CLI::Option* const overwrite =
      command->add_flag("--overwrite", r->overwrite, "replace an existing run");
  command->add_flag("--resume", r->resume, "continue an interrupted merge")->excludes(overwrite);
  command->callback([r] { merge(*r); });
}

}  // namespace apvi::cli
