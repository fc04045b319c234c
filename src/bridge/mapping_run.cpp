// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/bridge/mapping_run.hpp"

#include <fmt/format.h>
#include <sys/resource.h>
#include <torch/torch.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <system_error>

#include "apvi/bridge/camera_conversion.hpp"
#include "apvi/bridge/image_files.hpp"
#include "apvi/bridge/initial_points.hpp"
#include "apvi/bridge/posed_images.hpp"
#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/core/progress.hpp"
#include "apvi/core/stopwatch.hpp"
#include "apvi/eval/metrics_file.hpp"
#include "apvi/io/tum.hpp"
#include "apvi/mapping/evaluation.hpp"
#include "apvi/mapping/initial_map.hpp"
#include "apvi/mapping/initial_medium.hpp"
#include "apvi/mapping/trainer.hpp"
#include "apvi/splat/ply.hpp"
#include "apvi/version.hpp"
#include "held_out_report.hpp"

namespace apvi::bridge {
namespace {

namespace fs = std::filesystem;

constexpr const char* kCurveHeader = "#time [s],iteration,gaussians,psnr_heldout [dB]\n";

void prepare_folder(const MappingRunOptions& options) {
  const fs::path& folder = options.folder;
  if (fs::exists(folder) && !fs::is_directory(folder)) {
    fail_input("{}: this is a file; a run needs a folder", folder.string());
  }
  const bool taken = fs::exists(folder / "map.ply") || fs::exists(folder / "trajectory.tum");
  if (taken && !options.overwrite && !options.resume) {
    fail_input(
        "{}: holds a run already; name another folder with -o, or give --overwrite or "
        "--resume",
        folder.string());
  }
  std::error_code error;
  fs::create_directories(folder / "renders", error);
  if (error) fail_run("{}: cannot make this folder: {}", folder.string(), error.message());
  if (options.resume) return;
  for (const char* stale : {"metrics.json", "report.html", "mapping.csv", "checkpoint.pt"}) {
    fs::remove(folder / stale, error);
  }
}

// Paths in a resolved configuration hold wherever the program is started from.
void write_resolved(const RunConfig& config, const config::Node& rig, const fs::path& file) {
  const auto absolute = [](const std::string& path) {
    return path.empty() ? path : fs::absolute(path).lexically_normal().string();
  };
  RunConfig resolved = config;
  resolved.dataset.path = absolute(config.dataset.path);
  resolved.localization.poses = absolute(config.localization.poses);
  const std::string& points = config.mapping.initial_points;
  if (points != "sift" && points != "random") resolved.mapping.initial_points = absolute(points);
  resolved.dataset.rig.clear();  // its content is in `rig`
  resolved.rig = rig;
  io::write_text_file(file, config::to_yaml(config::to_node(resolved)));
}

/// The training of one run, with what it leaves in its folder on the way.
class Training {
 public:
  Training(const RunConfig& config, const MappingRunOptions& options, const PosedImages& images)
      : config_(config),
        options_(options),
        images_(images),
        trainer_(make_trainer(config, images.store)) {
    const fs::path checkpoint = options.folder / "checkpoint.pt";
    if (options.resume && fs::exists(checkpoint)) {
      trainer_.resume(checkpoint);
      log::info("resumed at iteration {}", trainer_.iteration());
    }
    curve_.open(options.folder / "mapping.csv", options.resume ? std::ios::app : std::ios::out);
    if (curve_.tellp() == 0) curve_ << kCurveHeader;
    reported_s_ = trainer_.seconds();
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
      maybe_report();
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
    const auto medium = trainer_.medium();
    splat::write_ply(options_.folder / "map.ply", trainer_.map(), medium);
    if (medium) splat::write_medium_json(options_.folder / "medium.json", *medium);
    io::write_tum(options_.folder / "keyframes.tum", keyframes());
    curve_.flush();
    if (!curve_) fail_run("{}: cannot be written; is the disk full?", curve_file().string());
  }

  mapping::Map map() const {
    return {.gaussians = trainer_.map(),
            .medium = trainer_.medium(),
            .antialiased = config_.mapping.trainer.antialiased};
  }
  const mapping::Trainer& trainer() const { return trainer_; }

 private:
  static mapping::Trainer make_trainer(const RunConfig& config,
                                       const mapping::KeyframeStore& store) {
    const mapping::TrainerOptions options = trainer_options(config);
    const mapping::InitialMapOptions initial = {.sh_degree = options.sh_degree,
                                                .opacity = config.mapping.initial_opacity};
    const splat::Gaussians map = mapping::initial_map(initial_points(config, store), initial);
    std::optional<splat::Medium> water;
    if (config.mapping.medium) water = mapping::initial_medium(map, store);
    return {store, map, options, water};
  }

  fs::path curve_file() const { return options_.folder / "mapping.csv"; }

  void maybe_report() {
    const double every = config_.mapping.report_every_s;
    if (every <= 0.0 || trainer_.seconds() - reported_s_ < every) return;
    reported_s_ = trainer_.seconds();
    const auto psnr = mapping::mean_psnr(map(), images_.store, images_.store.held_out());
    if (!psnr) return;
    curve_ << fmt::format("{:.2f},{},{},{:.4f}\n", trainer_.seconds(), trainer_.iteration(),
                          trainer_.size(), *psnr);
    curve_.flush();
    log::debug("{:.0f} s: {:.2f} dB on held-out images", trainer_.seconds(), *psnr);
  }

  void save_checkpoint() const { trainer_.save(options_.folder / "checkpoint.pt"); }

  // Poses of the body, those of the training images as corrected.
  Trajectory keyframes() const {
    Trajectory trajectory;
    const mapping::KeyframeStore& store = images_.store;
    for (std::size_t i = 0; i < store.size(); ++i) {
      const torch::Tensor delta = trainer_.corrections().pose_delta(i, /*learn=*/false);
      const SE3 T_camera_world = to_se3(mapping::corrected_pose(store[i].T_camera_world, delta));
      trajectory.poses.push_back({Stamp{store[i].stamp_ns} - images_.camera_delay,
                                  T_camera_world.inverse() * images_.T_body_camera.inverse()});
    }
    return trajectory;
  }

  const RunConfig& config_;
  const MappingRunOptions& options_;
  const PosedImages& images_;
  mapping::Trainer trainer_;
  std::ofstream curve_;
  double reported_s_ = 0.0;
};

double peak_memory_mib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

eval::Json medium_json(const splat::Medium& medium) {
  const auto list = [](const torch::Tensor& values) {
    const torch::Tensor v = values.to(torch::kCPU, torch::kFloat64).contiguous();
    return std::vector<double>(v.data_ptr<double>(), v.data_ptr<double>() + 3);
  };
  return {{"beta_d", list(medium.beta_d)},
          {"beta_b", list(medium.beta_b)},
          {"b_inf", list(medium.b_inf)}};
}

void write_metrics(const fs::path& file, const Training& training, eval::Json figures,
                   double wall_s) {
  const mapping::Trainer& trainer = training.trainer();
  figures["gaussians"] = trainer.size();
  figures["iterations"] = trainer.iteration();
  eval::Json sections = {
      {"mapping", figures},
      {"speed",
       {{"wall_s", wall_s},
        {"training_s", trainer.seconds()},
        {"iterations_per_s",
         static_cast<double>(trainer.iteration()) / std::max(1e-9, trainer.seconds())},
        {"rss_peak_mib", peak_memory_mib()}}},
      {"build", {{"backend", kBackend}, {"git", kGitRevision}, {"torch", TORCH_VERSION}}}};
  if (const auto medium = trainer.medium()) sections["medium"] = medium_json(*medium);
  eval::merge_metrics(file, sections);
}

}  // namespace

MappingRunResult run_mapping(const RunConfig& config, const MappingRunOptions& options) {
  const Stopwatch watch;
  torch::set_num_threads(config.run.threads);
  const PosedImages images = load_posed_images(config);
  prepare_folder(options);
  log::open_file(options.folder / "log.txt");
  write_resolved(config, images.rig, options.folder / "resolved.yaml");
  log::info("{} -> {}", config.dataset.path, options.folder.string());
  Training training(config, options, images);
  const bool finished = training.run();
  training.save();
  const eval::Json figures =
      report_held_out(training.map(), images.store, options.folder / "renders");
  write_metrics(options.folder / "metrics.json", training, figures, watch.seconds());
  const mapping::Trainer& trainer = training.trainer();
  return {.interrupted = !finished,
          .iterations = trainer.iteration(),
          .gaussians = trainer.size(),
          .wall_s = watch.seconds(),
          .psnr_db = figures.value("psnr_db", std::numeric_limits<double>::quiet_NaN())};
}

}  // namespace apvi::bridge
