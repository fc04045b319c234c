// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/mapping_run.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>

#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/sensors/rig.hpp"
#include "core/status_line.hpp"
#include "core/stopwatch.hpp"
#include "eval/metrics_file.hpp"
#include "mapping/density/initial_map.hpp"
#include "mapping/medium/initial_medium.hpp"
#include "mapping/training/trainer.hpp"
#include "medium/medium_initialization.hpp"
#include "runs/maps/initial_points.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/maps/map_files.hpp"
#include "runs/maps/posed_images.hpp"
#include "runs/maps/tone_curve.hpp"
#include "runs/quality/held_out_report.hpp"
#include "runs/quality/moving_report.hpp"
#include "runs/quality/simulated_truth.hpp"
#include "runs/run_folder.hpp"
#include "runs/scale.hpp"
#include "runs/views/image_files.hpp"
#include "slam/camera_conversion.hpp"
#include "slam/mapper_options.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

/// Training of one run, with its checkpoints and progress log.
class Training {
 public:
  Training(const RunConfig& config, const MappingRunOptions& options, PosedImages& images)
      : config_(config),
        options_(options),
        images_(images),
        trainer_(make_trainer(config, images)),
        log_(options.folder / "mapping.csv", config.mapping.report_every_s, options.resume) {
    const fs::path checkpoint = options.folder / kCheckpointFile;
    if (options.resume && fs::exists(checkpoint)) {
      trainer_.resume(checkpoint);
      log::info("resumed at iteration {}", trainer_.iteration());
    }
    log_.start_at(trainer_.seconds());
  }

  bool run() {
    StatusLine status("mapping");
    double loss = 0.0;
    Stopwatch since_checkpoint;
    while (!trainer_.done()) {
      const double latest = trainer_.step();
      loss = loss == 0.0 ? latest : 0.98 * loss + 0.02 * latest;
      status.update(trainer_.progress(), fmt::format("iteration {}, {} Gaussians, loss {:.4f}",
                                                     trainer_.iteration(), trainer_.size(), loss));
      if (options_.interrupted()) return false;
      if (log_.due(trainer_.seconds())) {
        log_.write(trainer_.seconds(), trainer_.iteration(), map(), images_.store);
      }
      if (config_.mapping.checkpoint_every_s > 0.0 &&
          since_checkpoint.seconds() > config_.mapping.checkpoint_every_s) {
        save_checkpoint();
        since_checkpoint.reset();
      }
    }
    return true;
  }

  void save() {
    save_checkpoint();
    write_map(options_.folder, map(), images_.origin);
    io::write_tum(options_.folder / "keyframes.tum", body_poses(images_, trainer_.corrections()));
    log_.close();
  }

  mapping::Map map() const { return trainer_.full_map(); }
  const mapping::Trainer& trainer() const { return trainer_; }

 private:
  static mapping::Trainer make_trainer(const RunConfig& config, PosedImages& images) {
    mapping::KeyframeStore& store = images.store;
    const mapping::TrainerOptions options =
        slam::trainer_options(config.mapping, config.run.seed, make_rig(images.rig));
    const mapping::InitialMapOptions initial = {.sh_degree = options.sh_degree,
                                                .opacity = config.mapping.initial_opacity};
    store.set_tone_curve(mapping::ToneCurveEvidence(options.tone_curve).initial());
    gaussians::PointCloud points = initial_points(config, store, images.origin);
    points.colors = store.tone_curve().decode(points.colors);
    const gaussians::Gaussians map = mapping::initial_map(points, initial);
    std::optional<medium::Medium> water;
    if (config.mapping.medium) {
      // With a lamp, images also darken with distance because of the light's falloff.
      water =
          options.lamps.empty() ? mapping::initial_medium(map, store) : medium::coastal_medium();
    }
    return {store, map, options, water};
  }

  void save_checkpoint() const { trainer_.save(options_.folder / kCheckpointFile); }

  const RunConfig& config_;
  const MappingRunOptions& options_;
  PosedImages& images_;
  mapping::Trainer trainer_;
  MappingLog log_;
};

MappingRunResult train_map(const RunConfig& config, const MappingRunOptions& options) {
  const Stopwatch watch;
  torch::set_num_threads(config.run.threads);
  PosedImages images = load_posed_images(config);
  if (!options.resume) prepare_folder(options.folder, options.overwrite);
  const fs::path renders = make_renders_folder(options.folder);
  log::open_file(options.folder / "log.txt");
  io::write_text_file(options.folder / "resolved.yaml",
                      config::to_yaml(config::to_node(resolved(config, images.rig))));
  log::info("{} -> {}", config.dataset.path, options.folder.string());
  const ScaleSource scale =
      scale_of_given_poses(config.dataset.path, config.localization.poses_file);
  warn_about_scale(scale);
  Training training(config, options, images);
  bool finished = false;
  try {
    finished = training.run();
  } catch (...) {
    save_or_log([&] { training.save(); });
    throw;
  }
  training.save();
  const auto truth =
      SimulatedTruth::open(config.dataset.path, images.camera, config.mapping.image_scale);
  eval::Json figures =
      report_held_out(training.map(), images.store, renders, truth ? &*truth : nullptr);
  const mapping::Trainer& trainer = training.trainer();
  if (const mapping::RobustWeights* weights = trainer.robust_weights()) {
    figures["moving"] =
        report_moving(*weights, images.store, options.folder / "moving", truth ? &*truth : nullptr);
  }
  eval::Json sections = eval::Json::object();
  sections["scale"] = scale_json(scale);
  eval::merge_metrics(options.folder / "metrics.json", sections);
  write_map_metrics(options.folder / "metrics.json",
                    {.held_out = figures,
                     .gaussians = trainer.size(),
                     .reduced_max_gaussians = reduced_limit(trainer.max_gaussians(), config),
                     .iterations = trainer.iteration(),
                     .training_s = trainer.seconds(),
                     .wall_s = watch.seconds(),
                     .wants_medium = config.mapping.medium,
                     .medium = trainer.medium(),
                     .true_medium = truth ? truth->medium() : std::nullopt});
  return {.interrupted = !finished,
          .iterations = trainer.iteration(),
          .gaussians = trainer.size(),
          .wall_s = watch.seconds(),
          .psnr_db = figures.value("psnr_db", std::numeric_limits<double>::quiet_NaN())};
}

}  // namespace

MappingRunResult run_mapping(const RunConfig& config, const MappingRunOptions& options) {
  return with_oom_message(config, options.folder,
                          [&] { return train_map(with_tone_curve(config), options); });
}

}  // namespace apvi::runs
