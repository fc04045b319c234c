// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <filesystem>
#include <memory>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "cli/commands.hpp"
#include "core/child_process.hpp"
#include "core/interrupt.hpp"
#include "runs/refine/refine_run.hpp"

namespace apvi::cli {
namespace {

struct Arguments {
  runs::RefineRequest request;
  std::filesystem::path join;
};

void join(const Arguments& a) {
  const InterruptGuard guard;
  const bool finished =
      runs::join_refinement(a.join, a.request.threads, [&guard] { return guard.interrupted(); });
  if (!finished) fail_run("interrupted; the work so far is saved");
}

void refine(runs::RefineRequest request) {
  if (request.run.empty() && !request.resume) {
    fail_input("RUN: missing: a run folder with a map, or --resume, or --join");
  }
  if (request.folder.empty()) fail_input("-o: missing: the folder of the refined map");
  const InterruptGuard guard;
  request.interrupted = [&guard] { return guard.interrupted(); };
  request.program = current_executable();
  const runs::RefineResultSummary result = runs::refine_run(request);
  if (result.interrupted) {
    log::warning("interrupted; the work so far is saved, --resume continues from it");
    return;
  }
  log::info("{} Gaussians after {} steps, {:.0f} s in total", result.gaussians, result.steps,
            result.wall_s);
  if (std::isnan(result.psnr_db)) return;
  log::info("{:.2f} dB PSNR on held-out images, {:.2f} dB before", result.psnr_db,
            result.psnr_before_db);
}

void add_plan_options(CLI::App& command, runs::RefinePlanOptions& plan) {
  command.add_option("--blocks", plan.blocks, "number of blocks; default: one for 600 images")
      ->check(CLI::Range(1, 100000))
      ->type_name("N");
  command.add_option("--rounds", plan.rounds, "how often the blocks exchange their results")
      ->check(CLI::Range(1, 1000))
      ->type_name("N")
      ->capture_default_str();
  command
      .add_option("--steps-per-image", plan.steps_per_image,
                  "optimization steps for each training image of a block, in all rounds")
      ->check(CLI::Range(1, 100000))
      ->type_name("N")
      ->capture_default_str();
  command
      .add_option("--max-gaussians", plan.max_gaussians,
                  "limit for a block with what surrounds it; default: as the run was configured")
      ->check(CLI::Range(100, 2000000000))
      ->type_name("N");
}

}  // namespace

void add_refine(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  runs::RefineRequest& r = a->request;
  CLI::App* command = app.add_subcommand(
      "refine", "optimize the map of a finished run further, in blocks, on any number of GPUs");
  command->add_option("RUN", r.run, "run folder with a map")->type_name("FOLDER");
  command->add_option("-o,--output", r.folder, "folder of the refined map")->type_name("FOLDER");
  command
      ->add_option("--devices", r.devices,
                   "processes, one for each GPU; default: all GPUs, or one process without a GPU")
      ->check(CLI::Range(1, 1024))
      ->type_name("N");
  command->add_option("--threads", r.threads, "of the CPU, in all processes; default: as the run")
      ->check(CLI::Range(1, 1024))
      ->type_name("N");
  add_plan_options(*command, r.plan);
  CLI::Option* const overwrite =
      command->add_flag("--overwrite", r.overwrite, "replace an existing run");
  command->add_flag("--resume", r.resume, "continue the refinement in the output folder")
      ->excludes(overwrite);
  command
      ->add_option("--join", a->join,
                   "take part in the refinement in this folder, for example from another host, "
                   "until it is done")
      ->type_name("FOLDER");
  command->callback([a] { a->join.empty() ? refine(a->request) : join(*a); });
}

}  // namespace apvi::cli
