// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/bridge/online_run.hpp"

#include <torch/torch.h>

#include <limits>
#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/core/stopwatch.hpp"
#include "apvi/io/sequence.hpp"
#include "held_out_report.hpp"
#include "map_files.hpp"
#include "online_map.hpp"
#include "simulated_truth.hpp"

namespace apvi::bridge {
namespace {

namespace fs = std::filesystem;

Rig rig_of(const RunConfig& config) {
  const auto reader = io::open_sequence(config.dataset, {"camera"});
  Rig rig = make_rig(pipeline::rig_of(config, reader->rig()));
  if (rig.cameras.empty()) {
    fail_input("{}: the rig has no cam0; mapping needs its calibration", config.dataset.path);
  }
  return rig;
}

std::optional<pipeline::RunResult> localize(const RunConfig& config,
                                            const MappingRunOptions& options, OnlineMap& map) {
  const pipeline::RunOptions run{
      .folder = options.folder,
      .overwrite = options.overwrite,
      .interrupted = options.interrupted,
      .describe = [&](const pipeline::RunConfig& used) { return describe(config, used); },
      .map = &map};
  std::optional<pipeline::RunResult> result;
  try {
    result = pipeline::run(config, run);
  } catch (...) {
    map.stop();
    rescue([&] { map.save(); });
    throw;
  }
  map.rethrow_failure();
  return result;
}

void continue_map(const RunConfig& config, const MappingRunOptions& options, const Rig& rig,
                  OnlineMap& map) {
  if (!fs::exists(options.folder / kCheckpoint)) {
    fail_input("{}: no {} there; run without --resume", options.folder.string(), kCheckpoint);
  }
  log::open_file(options.folder / "log.txt");
  map.begin(rig);
  map.resume();
  log::info("{}: goes on refining {} Gaussians at iteration {}", options.folder.string(),
            map.mapper().size(), map.mapper().iteration());
  if (config.mapping.trainer.final_iterations == 0) {
    log::warning("mapping.final_iterations: 0: there is nothing to do");
  }
}

MappingRunResult finish_map(const RunConfig& config, const MappingRunOptions& options,
                            const Rig& rig, OnlineMap& map, bool interrupted,
                            const Stopwatch& watch) {
  bool refined = false;
  try {
    refined = !interrupted && map.refine();
  } catch (...) {
    rescue([&] { map.save(); });
    throw;
  }
  map.save();
  const double wall_s = watch.seconds();
  const fs::path renders = make_renders_folder(options.folder);
  const mapping::Mapper& mapper = map.mapper();
  const auto truth = SimulatedTruth::open(config.dataset.path, rig.cameras.front().model,
                                          config.mapping.image_scale);
  const mapping::Map made = mapper.map();
  const eval::Json figures =
      report_held_out(made, mapper.keyframes(), renders, truth ? &*truth : nullptr);
  write_map_metrics(options.folder / "metrics.json",
                    {.held_out = figures,
                     .gaussians = mapper.size(),
                     .most_gaussians = set_by_memory(mapper.most_gaussians(), config),
                     .iterations = mapper.iteration(),
                     .training_s = map.training_s(),
                     .wall_s = wall_s,
                     .medium = made.medium,
                     .true_medium = truth ? truth->medium() : std::nullopt,
                     .dropped_keyframes = map.dropped_keyframes(),
                     .closed_loops = map.closed_loops(),
                     .not_mapped = map.not_mapped(),
                     .times = map.times()});
  return {.interrupted = !refined,
          .iterations = mapper.iteration(),
          .gaussians = mapper.size(),
          .wall_s = wall_s,
          .psnr_db = figures.value("psnr_db", std::numeric_limits<double>::quiet_NaN())};
}

OnlineRunResult localize_and_map(const RunConfig& config, const MappingRunOptions& options) {
  const Stopwatch watch;
  torch::set_num_threads(config.run.threads);
  const Rig rig = rig_of(config);
  OnlineMap map(config, options, rig);
  OnlineRunResult result;
  if (options.resume) {
    continue_map(config, options, rig, map);
  } else {
    result.localization = localize(config, options, map);
  }
  const bool interrupted = result.localization && result.localization->interrupted;
  if (map.mapper().size() == 0 && interrupted) {
    result.map = {.interrupted = true, .psnr_db = std::numeric_limits<double>::quiet_NaN()};
    return result;
  }
  if (map.mapper().size() == 0) {
    fail_run("{}: no map: vision was never stable enough for a keyframe; {}", config.dataset.path,
             "health.csv says why");
  }
  result.map = finish_map(config, options, rig, map, interrupted, watch);
  return result;
}

}  // namespace

OnlineRunResult run_online(const RunConfig& config, const MappingRunOptions& options) {
  return within_memory(config, options.folder, [&] { return localize_and_map(config, options); });
}

}  // namespace apvi::bridge
