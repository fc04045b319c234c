// SPDX-License-Identifier: BSD-3-Clause
#include "runs/refine/refine_report.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "gaussians/device.hpp"
#include "gaussians/model/rows.hpp"
#include "map_io/ply.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/maps/map_files.hpp"
#include "runs/maps/posed_images.hpp"
#include "runs/maps/stored_map.hpp"
#include "runs/quality/held_out_report.hpp"
#include "runs/quality/simulated_truth.hpp"
#include "runs/refine/refine_result.hpp"
#include "runs/run_config.hpp"
#include "runs/run_folder.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr double kMaxImageGib = 8.0;  // of the images that are loaded for the evaluation
// Of the run that the refined map is still in the frame of.
constexpr std::array kKeptFiles = {"metrics.json", "trajectory.tum",     "trajectory_smoothed.tum",
                                   "places.bin",   "rig_estimated.yaml", "origin.json"};

RefineResult all_blocks(const fs::path& folder, const RefinePlan& plan) {
  std::vector<RefineResult> results;
  for (int block = 0; block < plan.partition.size(); ++block) {
    results.push_back(read_result(result_file(folder, {.round = plan.rounds - 1, .block = block})));
  }
  return join(std::move(results));
}

/// The poses at all images of the map, those of the training images as refined.
Trajectory refined_poses(const RefinePlan& plan, const RefineResult& all,
                         const SE3& T_body_camera) {
  Trajectory poses = io::read_trajectory(plan.run / "keyframes.tum");
  const auto rows = rows_by_stamp(all);
  std::map<std::int64_t, SE3> refined;
  for (const RefineImage& image : plan.images) {
    const auto row = rows.find(image.image.ns);
    if (row == rows.end()) continue;
    const SE3 T_camera_world = slam::to_se3(all.poses[row->second]);
    refined[image.taken.ns] = T_camera_world.inverse() * T_body_camera.inverse();
  }
  Trajectory local = to_local(std::move(poses), plan.origin);
  for (StampedPose& pose : local.poses) {
    if (const auto found = refined.find(pose.stamp.ns); found != refined.end()) {
      pose.T_world_body = found->second;
    }
  }
  return to_recording(std::move(local), plan.origin);
}

/// The poses whose images are loaded for the evaluation: all that are held out, and as many others
/// as fit in memory.
Trajectory evaluated_poses(const RefinePlan& plan, const Trajectory& poses,
                           const gaussians::Intrinsics& camera) {
  const double bytes = 3.0 * camera.width * camera.height * static_cast<double>(plan.images.size());
  const double gib = bytes / static_cast<double>(1 << 30);
  const auto stride = static_cast<std::size_t>(std::max(1.0, std::ceil(gib / kMaxImageGib)));
  if (stride == 1) return poses;
  std::map<std::int64_t, std::size_t> number;
  for (std::size_t i = 0; i < plan.images.size(); ++i) number[plan.images[i].taken.ns] = i;
  Trajectory kept;
  for (const StampedPose& pose : poses.poses) {
    const auto training = number.find(pose.stamp.ns);
    if (training == number.end() || training->second % stride == 0) kept.poses.push_back(pose);
  }
  return kept;
}

/// Values [n,...] of the results for each image of the store; zero for held-out ones.
Tensor by_image(const Tensor& values, const std::map<std::int64_t, std::int64_t>& rows,
                const mapping::KeyframeStore& store) {
  if (!values.defined()) return {};
  std::vector<Tensor> all;
  for (std::size_t i = 0; i < store.size(); ++i) {
    const auto row = rows.find(store[i].stamp_ns);
    all.push_back(row != rows.end() ? values[row->second] : torch::zeros_like(values[0]));
  }
  return torch::stack(all).to(gaussians::active_device());
}

mapping::Map map_of(RefineResult& all, const fs::path& folder, const RefinePlan& plan,
                    const PosedImages& images, bool antialiased) {
  const auto rows = rows_by_stamp(all);
  mapping::Map map;
  map.medium = map_io::read_ply_medium(initial_map_file(folder));
  map.antialiased = antialiased;
  map.log_gains = by_image(all.log_gains, rows, images.store);
  map.illumination = by_image(all.illumination, rows, images.store);
  map.vignetting = plan.vignetting;
  map.tone_curve = plan.tone_curve;
  map.gaussians =
      gaussians::on_device(std::exchange(all.gaussians, {}), gaussians::active_device());
  return map;
}

double psnr_of(const eval::Json& mapping) {
  return mapping.value("psnr_db", std::numeric_limits<double>::quiet_NaN());
}

void write_figures(const fs::path& folder, const RefinePlan& plan, const RefineFigures& figures,
                   double wall_s) {
  eval::Json sections = eval::Json::object();
  sections["refine"] = {{"run", plan.run.string()},
                        {"blocks", plan.blocks.size()},
                        {"rounds", plan.rounds},
                        {"steps_per_image", plan.steps_per_image},
                        {"images", plan.images.size()},
                        {"steps", figures.steps},
                        {"psnr_before_db", figures.psnr_before_db},
                        {"wall_s", wall_s}};
  eval::merge_metrics(folder / "metrics.json", sections);
}

}  // namespace

RefineFigures write_refined_run(const fs::path& folder, const RefinePlan& plan, double wall_s) {
  const torch::NoGradGuard no_grad;
  const RunConfig config = load_recorded_run_config(plan.run / "resolved.yaml");
  const CameraMount mount = mount_of_run(config);
  RefineResult all = all_blocks(folder, plan);
  copy_files(plan.run, folder, kKeptFiles);
  const Trajectory poses = refined_poses(plan, all, mount.T_body_camera);
  io::write_tum(folder / "keyframes.tum", poses);
  PosedImages images = load_posed_images(
      config,
      {.origin = plan.origin, .poses_of_images = evaluated_poses(plan, poses, mount.intrinsics)});
  images.store.move_images(torch::kCPU);
  io::write_text_file(folder / "resolved.yaml",
                      config::to_yaml(config::to_node(resolved(config, images.rig))));
  const std::int64_t steps = all.steps;
  const double training_s = all.seconds;
  const mapping::Map map = map_of(all, folder, plan, images, config.mapping.trainer.antialiased);
  write_map(folder, map, plan.origin);
  const auto truth =
      SimulatedTruth::open(config.dataset.path, images.camera, config.mapping.image_scale);
  const eval::Json held_out =
      report_held_out(map, images.store, make_renders_folder(folder), truth ? &*truth : nullptr);
  const eval::Json before = eval::read_metrics(plan.run / "metrics.json");
  const RefineFigures figures{
      .gaussians = map.gaussians.size(),
      .steps = steps,
      .psnr_db = psnr_of(held_out),
      .psnr_before_db = psnr_of(before.value("mapping", eval::Json::object()))};
  write_map_metrics(folder / "metrics.json",
                    {.held_out = held_out,
                     .gaussians = figures.gaussians,
                     .iterations = steps,
                     .training_s = training_s,
                     .wall_s = wall_s,
                     .wants_medium = config.mapping.medium,
                     .medium = map.medium,
                     .true_medium = truth ? truth->medium() : std::nullopt});
  write_figures(folder, plan, figures, wall_s);
  return figures;
}

}  // namespace apvi::runs
