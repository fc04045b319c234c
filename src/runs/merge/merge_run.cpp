// SPDX-License-Identifier: BSD-3-Clause
#include "runs/merge/merge_run.hpp"

#include <fmt/format.h>
#include <torch/torch.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "core/status_line.hpp"
#include "core/stopwatch.hpp"
#include "gaussians/model/point_cloud.hpp"
#include "runs/maps/map_files.hpp"
#include "runs/merge/merge_frame.hpp"
#include "runs/merge/merge_input.hpp"
#include "runs/quality/held_out_report.hpp"
#include "runs/quality/simulated_truth.hpp"
#include "runs/run_folder.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

constexpr int kIterationsPerImage = 10;

/// The map of a session as a map of its own: colors are those in its light.
mapping::Map in_own_light(mapping::Map map) {
  if (!map.light.defined()) return map;
  const torch::Tensor light = map.light.to(map.gaussians.sh_dc.options());
  map.gaussians.sh_dc =
      gaussians::color_to_sh_dc(gaussians::sh_dc_to_color(map.gaussians.sh_dc) * light);
  map.gaussians.sh_rest = map.gaussians.sh_rest * light;
  map.light = torch::Tensor();
  return map;
}

std::vector<float> numbers_of(const torch::Tensor& light) {
  if (!light.defined()) return {1.0F, 1.0F, 1.0F};
  const torch::Tensor values = light.to(torch::kCPU, torch::kFloat32).contiguous();
  return {values.data_ptr<float>(), values.data_ptr<float>() + values.numel()};
}

bool continues(const MergeRequest& request) {
  return request.resume && fs::exists(request.folder / kCheckpointFile);
}

/// The training of the joint map, and its files.
class Merge {
 public:
  Merge(const MergeRequest& request, const std::vector<MergeSession>& sessions)
      : request_(request),
        sessions_(sessions),
        joint_(load_joint_mapping(sessions)),
        trainer_(training_sessions(), joint_.initial) {
    joint_.initial = {};  // the trainer has its own
    if (!continues(request)) return;
    trainer_.resume(request.folder / kCheckpointFile);
    log::info("resumed at iteration {}", trainer_.iteration());
  }

  /// False when it was interrupted.
  bool run() {
    StatusLine status("merging");
    double loss = 0.0;
    while (!trainer_.done()) {
      const double latest = trainer_.step();
      loss = loss == 0.0 ? latest : 0.98 * loss + 0.02 * latest;
      status.update(trainer_.progress(), fmt::format("iteration {}, {} Gaussians, loss {:.4f}",
                                                     trainer_.iteration(), trainer_.size(), loss));
      if (request_.interrupted()) return false;
    }
    return true;
  }

  void save() {
    trainer_.save(request_.folder / kCheckpointFile);
    for (std::size_t i = 0; i < sessions_.size(); ++i) save_session(i);
  }

  /// Figures of the held-out images, into the metrics of every session.
  MergeResult report(double wall_s, const std::vector<eval::Json>& graphs) {
    MergeResult result;
    result.iterations = trainer_.iteration();
    result.gaussians = trainer_.size();
    result.wall_s = wall_s;
    eval::Json list = eval::Json::array();
    for (std::size_t i = 0; i < sessions_.size(); ++i) {
      list.push_back(report_session(i, wall_s));
      if (i < graphs.size()) list.back()["graph"] = graphs[i];
      result.psnr_db.push_back(
          list.back().value("psnr_db", std::numeric_limits<double>::quiet_NaN()));
    }
    eval::Json sections = eval::Json::object();
    sections["sessions"] = list;
    eval::merge_metrics(request_.folder / "metrics.json", sections);
    return result;
  }

 private:
  std::vector<mapping::TrainingSession> training_sessions() {
    std::size_t images = 0;
    for (const PosedImages& session : joint_.images) images += session.store.training().size();
    const int iterations = request_.iterations > 0 ? request_.iterations
                                                   : kIterationsPerImage * static_cast<int>(images);
    log::info("{} iterations over {} images", iterations, images);
    std::vector<mapping::TrainingSession> all;
    for (std::size_t i = 0; i < sessions_.size(); ++i) {
      all.push_back(training_session(sessions_[i], joint_, i, iterations));
    }
    return all;
  }

  void save_session(std::size_t i) const {
    const fs::path folder = session_folder(request_.folder, i);
    const PosedImages& images = joint_.images[i];
    write_map(folder, in_own_light(trainer_.full_map(i)), images.origin);
    io::write_tum(folder / "keyframes.tum", body_poses(images, trainer_.corrections(i)));
    io::write_text_file(
        folder / "resolved.yaml",
        config::to_yaml(config::to_node(resolved(sessions_[i].config, images.rig))));
  }

  eval::Json report_session(std::size_t i, double wall_s) const {
    const fs::path folder = session_folder(request_.folder, i);
    const PosedImages& images = joint_.images[i];
    const RunConfig& config = sessions_[i].config;
    const auto truth =
        SimulatedTruth::open(config.dataset.path, images.camera, config.mapping.image_scale);
    const mapping::Map map = trainer_.full_map(i);
    const eval::Json figures =
        report_held_out(map, images.store, make_renders_folder(folder), truth ? &*truth : nullptr);
    write_map_metrics(folder / "metrics.json",
                      {.held_out = figures,
                       .gaussians = trainer_.size(),
                       .reduced_max_gaussians = reduced_limit(trainer_.max_gaussians(), config),
                       .iterations = trainer_.iteration(),
                       .training_s = trainer_.seconds(),
                       .wall_s = wall_s,
                       .wants_medium = config.mapping.medium,
                       .medium = map.medium,
                       .true_medium = truth ? truth->medium() : std::nullopt});
    eval::Json json = {{"run", sessions_[i].run.string()},
                       {"images", images.store.size()},
                       {"heldout_views", images.store.held_out().size()},
                       {"light", numbers_of(map.light)}};
    if (figures.contains("psnr_db")) json["psnr_db"] = figures["psnr_db"];
    if (sessions_[i].psnr_db) json["psnr_own_map_db"] = *sessions_[i].psnr_db;
    return json;
  }

  const MergeRequest& request_;
  const std::vector<MergeSession>& sessions_;
  JointMapping joint_;
  mapping::Trainer trainer_;
};

void prepare_folders(const MergeRequest& request) {
  for (std::size_t i = 0; i < request.runs.size() && !continues(request); ++i) {
    prepare_folder(session_folder(request.folder, i), request.overwrite || request.resume);
  }
  log::open_file(request.folder / "log.txt");
}

void check(const MergeRequest& request) {
  if (request.runs.size() < 2) fail_input("merge: needs at least two runs");
  for (std::size_t i = 0; i < request.runs.size(); ++i) {
    const fs::path& run = request.runs[i];
    if (!fs::is_directory(run)) fail_input("{}: not a folder", run.string());
    std::error_code error;
    for (std::size_t k = 0; k < i; ++k) {
      if (!fs::equivalent(run, request.runs[k], error)) continue;
      fail_input("{}: given twice", run.string());
    }
    if (!fs::equivalent(run, request.folder, error)) continue;
    fail_input("{}: the merged map cannot replace one of its runs", run.string());
  }
  if (!request.resume) check_vacant(request.folder, request.overwrite);
}

MergeResult merge(const MergeRequest& request, const std::vector<MergeSession>& sessions,
                  const std::vector<eval::Json>& graphs) {
  const Stopwatch watch;
  Merge merge(request, sessions);
  bool finished = false;
  try {
    finished = merge.run();
  } catch (...) {
    save_or_log([&] { merge.save(); });
    throw;
  }
  merge.save();
  MergeResult result = merge.report(watch.seconds(), graphs);
  result.interrupted = !finished;
  return result;
}

}  // namespace

fs::path session_folder(const fs::path& folder, std::size_t index) {
  return index == 0 ? folder : folder / fmt::format("session{}", index + 1);
}

MergeResult merge_runs(const MergeRequest& request) {
  check(request);
  std::vector<MergeSession> sessions;
  for (const fs::path& run : request.runs) sessions.push_back(load_merge_session(run));
  std::vector<eval::Json> graphs;
  if (!request.same_frame) graphs = join_frames(sessions);
  const RunConfig& config = sessions.front().config;
  torch::set_num_threads(request.threads > 0 ? request.threads : config.run.threads);
  prepare_folders(request);
  return with_oom_message(config, request.folder, [&] { return merge(request, sessions, graphs); });
}

}  // namespace apvi::runs
