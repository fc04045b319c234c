// SPDX-License-Identifier: BSD-3-Clause
#include "runs/refine/refine_run.hpp"

#include <torch/cuda.h>
#include <torch/torch.h>

#include <algorithm>
#include <system_error>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "core/stopwatch.hpp"
#include "gaussians/device.hpp"
#include "runs/maps/map_files.hpp"
#include "runs/refine/refine_report.hpp"
#include "runs/refine/refine_workers.hpp"
#include "runs/run_config.hpp"
#include "runs/run_folder.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

void check(const RefineRequest& request) {
  if (request.resume) return;
  std::error_code error;
  if (!fs::is_directory(request.run)) fail_input("{}: not a folder", request.run.string());
  if (fs::equivalent(request.run, request.folder, error)) {
    fail_input("{}: the refined map cannot replace the run itself", request.folder.string());
  }
  check_vacant(request.folder, request.overwrite);
}

RefinePlan plan_for(const RefineRequest& request, int devices) {
  if (request.resume) return read_plan(request.folder);
  prepare_folder(request.folder, request.overwrite);
  fs::remove_all(refine_folder(request.folder));
  RefinePlanOptions options = request.plan;
  options.min_blocks = std::max(options.min_blocks, devices);
  return make_plan(request.run, request.folder, options);
}

int device_count(const RefineRequest& request) {
  const int gpus =
      gaussians::active_device().is_cuda() ? static_cast<int>(torch::cuda::device_count()) : 0;
  if (request.devices == 0) return std::max(1, gpus);
  if (gpus > 0 && request.devices > gpus) {
    fail_input("--devices {}: this machine has {}", request.devices, gpus);
  }
  return request.devices;
}

/// False when interrupted.
bool carry_out(const RefineRequest& request, const RefinePlan& plan, int devices, int threads) {
  if (devices == 1) return work(request.folder, plan, request.interrupted);
  return work_in_processes(
      request.folder, plan,
      {.program = request.program, .count = devices, .threads = std::max(1, threads / devices)},
      request.interrupted);
}

int threads_of(const RunConfig& config, int asked) {
  return asked > 0 ? asked : config.run.threads;
}

}  // namespace

RefineResultSummary refine_run(const RefineRequest& request) {
  const Stopwatch watch;
  check(request);
  const int devices = device_count(request);
  const RefinePlan plan = plan_for(request, devices);
  log::open_file(request.folder / "log.txt");
  const RunConfig config = load_recorded_run_config(plan.run / "resolved.yaml");
  const int threads = threads_of(config, request.threads);
  torch::set_num_threads(threads);
  return with_oom_message(config, request.folder, [&]() -> RefineResultSummary {
    if (!carry_out(request, plan, devices, threads)) return {.interrupted = true};
    const RefineFigures figures = write_refined_run(request.folder, plan, watch.seconds());
    fs::remove_all(refine_folder(request.folder));
    return {.gaussians = figures.gaussians,
            .steps = figures.steps,
            .wall_s = watch.seconds(),
            .psnr_db = figures.psnr_db,
            .psnr_before_db = figures.psnr_before_db};
  });
}

bool join_refinement(const fs::path& folder, int threads,
                     const std::function<bool()>& interrupted) {
  const RefinePlan plan = read_plan(folder);
  const RunConfig config = load_recorded_run_config(plan.run / "resolved.yaml");
  torch::set_num_threads(threads_of(config, threads));
  return with_oom_message(config, folder, [&] { return work(folder, plan, interrupted); });
}

}  // namespace apvi::runs
