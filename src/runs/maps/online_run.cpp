// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/online_run.hpp"

#include <torch/torch.h>

#include <limits>
#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/sequence.hpp"
#include "core/stopwatch.hpp"
#include "runs/maps/map_files.hpp"
#include "runs/maps/online_map.hpp"
#include "runs/maps/tone_curve.hpp"
#include "runs/quality/all_images_report.hpp"
#include "runs/quality/held_out_report.hpp"
#include "runs/quality/moving_report.hpp"
#include "runs/quality/simulated_truth.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

Rig rig_with_camera(const RunConfig& config, const io::SequenceReader& recording) {
  Rig rig = make_rig(runs::resolve_rig(config, recording.rig()));
  if (rig.cameras.empty()) {
    fail_input("{}: the rig has no cam0; mapping requires its calibration", config.dataset.path);
  }
  return rig;
}

/// Shows the observer what the mapper receives.
class ObservedSink : public localization::MapSink {
 public:
  ObservedSink(localization::MapSink& sink, RunObserver* observer)
      : sink_(sink), observer_(observer) {}
  void push(localization::MapFrame frame) override {
    if (observer_ != nullptr) observer_->image(frame);
    sink_.push(std::move(frame));
  }
  void finish() override { sink_.finish(); }
  std::string status() const override { return sink_.status(); }

 private:
  localization::MapSink& sink_;
  RunObserver* observer_;
};

/// Shows the observer the map as long as it exists.
class MapObservation {
 public:
  MapObservation(RunObserver* observer, OnlineMap& map) : observer_(observer) {
    if (observer_ == nullptr) return;
    observer_->map_begins(map.mapper(), [&map] { map.request_save(); });
  }
  ~MapObservation() {
    if (observer_ != nullptr) observer_->map_ends();
  }
  MapObservation(const MapObservation&) = delete;
  MapObservation& operator=(const MapObservation&) = delete;

 private:
  RunObserver* observer_;
};

std::optional<RunResult> localize(const RunConfig& config, io::SequenceReader& recording,
                                  const MappingRunOptions& options, OnlineMap& map) {
  ObservedSink sink(map.mapper(), options.observer);
  const RunOptions run{.folder = options.folder,
                       .overwrite = options.overwrite,
                       .interrupted = options.interrupted,
                       .folder_ready = [&] { map.open_files(); },
                       .map = &sink,
                       .live = options.live,
                       .observer = options.observer};
  std::optional<RunResult> result;
  try {
    result = runs::run(config, recording, run);
  } catch (...) {
    map.mapper().stop();
    save_or_log([&] { map.save(); });
    throw;
  }
  map.rethrow_failure();
  return result;
}

void continue_map(const MappingRunOptions& options, OnlineMap& map) {
  if (!fs::exists(options.folder / kCheckpointFile)) {
    fail_input("{}: no {} found; run without --resume", options.folder.string(), kCheckpointFile);
  }
  log::open_file(options.folder / "log.txt");
  map.open_files();
  map.mapper().resume(options.folder / kCheckpointFile);
  log::info("{}: resuming the refinement of {} Gaussians at iteration {}", options.folder.string(),
            map.mapper().mapper().size(), map.mapper().mapper().iteration());
  if (map.mapper().final_iterations() == 0) {
    log::warning("mapping.final_iterations: 0: nothing to do");
  }
}

MappingRunResult finish_map(const RunConfig& config, const MappingRunOptions& options,
                            const Rig& rig, OnlineMap& map, bool interrupted,
                            const Stopwatch& watch) {
  bool refined = false;
  try {
    refined = !interrupted && map.mapper().refine();
  } catch (...) {
    save_or_log([&] { map.save(); });
    throw;
  }
  map.save();
  const double wall_s = watch.seconds();
  const fs::path renders = make_renders_folder(options.folder);
  const slam::AsyncMapper& async = map.mapper();
  const mapping::Mapper& mapper = async.mapper();
  const auto truth = SimulatedTruth::open(config.dataset.path, rig.cameras.front().model,
                                          config.mapping.image_scale);
  const mapping::Map made = mapper.snapshot();
  eval::Json figures =
      report_held_out(made, mapper.keyframes(), renders, truth ? &*truth : nullptr);
  // Reads the recording once more: not after Ctrl-C.
  if (options.live == nullptr && !interrupted)
    add_all_images(made, mapper.keyframes(), config, options.folder, figures);
  if (const mapping::RobustWeights* weights = mapper.optimizer().robust_weights()) {
    figures["moving"] = report_moving(*weights, mapper.keyframes(), options.folder / "moving",
                                      truth ? &*truth : nullptr);
  }
  write_map_metrics(options.folder / "metrics.json",
                    {.held_out = figures,
                     .gaussians = mapper.size(),
                     .reduced_max_gaussians = reduced_limit(mapper.max_gaussians(), config),
                     .iterations = mapper.iteration(),
                     .training_s = async.training_s(),
                     .wall_s = wall_s,
                     .wants_medium = config.mapping.medium,
                     .medium = made.medium,
                     .true_medium = truth ? truth->medium() : std::nullopt,
                     .dropped_keyframes = async.dropped_keyframes(),
                     .closed_loops = async.closed_loops(),
                     .not_mapped = async.rejected(),
                     .times = map.times()});
  return {.interrupted = !refined,
          .iterations = mapper.iteration(),
          .gaussians = mapper.size(),
          .wall_s = wall_s,
          .psnr_db = figures.value("psnr_db", std::numeric_limits<double>::quiet_NaN())};
}

OnlineRunResult localize_and_map(const RunConfig& config, io::SequenceReader& recording,
                                 const MappingRunOptions& options) {
  const Stopwatch watch;
  torch::set_num_threads(config.run.threads);
  const Rig rig = rig_with_camera(config, recording);
  OnlineMap map(config, options, rig);
  const MapObservation observation(options.observer, map);
  OnlineRunResult result;
  if (options.resume) {
    continue_map(options, map);
  } else {
    result.localization = localize(config, recording, options, map);
  }
  const bool interrupted = result.localization && result.localization->interrupted;
  if (map.mapper().mapper().size() == 0 && interrupted) {
    result.map = {.interrupted = true, .psnr_db = std::numeric_limits<double>::quiet_NaN()};
    return result;
  }
  if (map.mapper().mapper().size() == 0) {
    fail_run("{}: no map: vision was never stable enough for a keyframe; {}", config.dataset.path,
             "see health.csv");
  }
  result.map = finish_map(config, options, rig, map, interrupted, watch);
  return result;
}

}  // namespace

OnlineRunResult run_online(const RunConfig& config, io::SequenceReader& recording,
                           const MappingRunOptions& options) {
  return with_oom_message(config, options.folder, [&] {
    return localize_and_map(with_tone_curve(config), recording, options);
  });
}

}  // namespace apvi::runs
