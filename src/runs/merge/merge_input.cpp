// SPDX-License-Identifier: BSD-3-Clause
#include "runs/merge/merge_input.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "eval/metrics_file.hpp"
#include "gaussians/device.hpp"
#include "gaussians/model/rows.hpp"
#include "gaussians/model/similarity.hpp"
#include "mapping/density/map_union.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/refine/refine_options.hpp"
#include "runs/survey/export.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr std::size_t kMaxUnionViews = 200;  // of a map, evenly spread

std::optional<double> psnr_of(const fs::path& run) {
  const eval::Json metrics = eval::read_metrics(run / "metrics.json");
  const auto mapping = metrics.find("mapping");
  if (mapping == metrics.end() || !mapping->contains("psnr_db")) return std::nullopt;
  return mapping->at("psnr_db").get<double>();
}

std::vector<gaussians::View> training_views(const mapping::KeyframeStore& store) {
  const std::vector<std::size_t>& training = store.training();
  const std::size_t stride = (training.size() + kMaxUnionViews - 1) / kMaxUnionViews;
  std::vector<gaussians::View> views;
  for (std::size_t i = 0; i < training.size(); i += stride) {
    views.push_back(store.view(training[i], 1));
  }
  return views;
}

/// Index [n] int64 of the nearest position [m,3] to each mean [n,3], in blocks that fit in memory.
Tensor nearest_of(const Tensor& means, const Tensor& positions) {
  constexpr std::int64_t kBlock = 1 << 16;
  std::vector<Tensor> parts = {torch::empty({0}, torch::kInt64)};
  for (std::int64_t first = 0; first < means.size(0); first += kBlock) {
    const Tensor block = means.slice(0, first, first + kBlock).to(torch::kFloat64);
    parts.push_back(torch::cdist(block, positions).argmin(1));
  }
  return torch::cat(parts);
}

}  // namespace

MergeSession load_merge_session(const fs::path& run) {
  for (const char* needed : {"map.ply", "resolved.yaml", "keyframes.tum"}) {
    if (fs::exists(run / needed)) continue;
    fail_input("{}: missing; is this the folder of a run with a map?", (run / needed).string());
  }
  return {.run = run,
          .config = load_recorded_run_config(run / "resolved.yaml"),
          .map = load_map(run),
          .poses = io::read_trajectory(run / "keyframes.tum"),
          .psnr_db = psnr_of(run)};
}

void move_session(MergeSession& session, const Trajectory& poses) {
  const Trajectory before = to_local(session.poses, session.map.origin);
  const Trajectory after = to_local(poses, session.map.origin);
  std::vector<Tensor> motions;
  std::vector<Tensor> positions;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const SE3& from = before.poses[i].T_world_body;
    motions.push_back(slam::to_tensor(after.poses[i].T_world_body * from.inverse()));
    const Eigen::Vector3d& p = from.translation;
    positions.push_back(torch::tensor({p.x(), p.y(), p.z()}, torch::kFloat64));
  }
  const Tensor which = nearest_of(session.map.gaussians.means, torch::stack(positions));
  session.map.gaussians = gaussians::transformed(
      session.map.gaussians, gaussians::rigid_transforms(torch::stack(motions)), which);
  session.poses = poses;
}

JointMapping load_joint_mapping(const std::vector<MergeSession>& sessions) {
  const torch::NoGradGuard no_grad;
  const map_io::Origin& origin = sessions.front().map.origin;
  JointMapping joint;
  for (const MergeSession& session : sessions) {
    log::info("images of {}", session.run.string());
    joint.images.push_back(
        load_posed_images(session.config, {.origin = origin, .poses_of_images = session.poses}));
    gaussians::Gaussians map =
        gaussians::on_device(session.map.gaussians, gaussians::active_device());
    map.means = rebased(map.means, session.map.origin, origin);
    if (joint.images.size() == 1) {
      joint.initial = map;
      joint.lights.push_back(torch::ones({3}));
      continue;
    }
    mapping::MapUnion both =
        mapping::unite(joint.initial, map, training_views(joint.images.back().store));
    log::info("{} of its {} Gaussians fill gaps of the map so far", both.added, map.size());
    joint.initial = std::move(both.gaussians);
    joint.lights.push_back(both.light);
  }
  return joint;
}

mapping::TrainingSession training_session(const MergeSession& session, JointMapping& joint,
                                          std::size_t index, int iterations) {
  PosedImages& images = joint.images[index];
  const RunConfig& config = session.config;
  return {
      .keyframes = &images.store,
      .options = refine_options(config, images, session.map.tone_curve, iterations),
      .medium = session.map.medium,
      .light = joint.lights[index],
      .response = mapping::CameraResponse{.vignetting = session.map.vignetting, .log_gains = {}}};
}

}  // namespace apvi::runs
