// SPDX-License-Identifier: BSD-3-Clause
#include "runs/refine/refine_input.hpp"

#include <torch/torch.h>

#include <map>
#include <tuple>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "gaussians/device.hpp"
#include "gaussians/model/rows.hpp"
#include "map_io/map_file.hpp"
#include "map_io/ply.hpp"
#include "mapping/blocks/block_views.hpp"
#include "runs/refine/refine_result.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

const RefineBlock& block_of(const RefinePlan& plan, const RefineTask& task) {
  return plan.blocks.at(static_cast<std::size_t>(task.block));
}

/// The poses of a block's images before the refinement.
Trajectory given_poses(const RefinePlan& plan, const RefineBlock& block) {
  const fs::path file = plan.run / "keyframes.tum";
  const Trajectory all = io::read_trajectory(file);
  std::map<std::int64_t, const StampedPose*> by_stamp;
  for (const StampedPose& pose : all.poses) by_stamp[pose.stamp.ns] = &pose;
  Trajectory poses;
  for (const std::size_t i : block.images) {
    const auto found = by_stamp.find(plan.images[i].taken.ns);
    if (found == by_stamp.end()) {
      fail_input("{}: has no pose at {} any more", file.string(), plan.images[i].taken.ns);
    }
    poses.poses.push_back(*found->second);
  }
  return poses;
}

/// Of the block and its neighbors; steps and seconds are those of the block.
RefineResult previous_results(const fs::path& folder, const RefinePlan& plan,
                              const RefineTask& task) {
  std::vector<RefineResult> results;
  std::pair<std::int64_t, double> own;
  for (const int block : block_of(plan, task).neighbors) {
    results.push_back(read_result(result_file(folder, {.round = task.round - 1, .block = block})));
    if (block == task.block) own = {results.back().steps, results.back().seconds};
  }
  RefineResult all = join(std::move(results));
  std::tie(all.steps, all.seconds) = own;
  return all;
}

/// Takes over poses and gains of the images.
void continue_from(const RefineResult& previous, const fs::path& folder, RefineInput& input) {
  const auto row_of = rows_by_stamp(previous);
  mapping::KeyframeStore& store = input.images.store;
  std::vector<std::int64_t> rows;
  for (std::size_t i = 0; i < store.size(); ++i) {
    const auto found = row_of.find(store[i].stamp_ns);
    if (found == row_of.end()) {
      fail_input("{}: image {} is in no result of the previous round",
                 refine_folder(folder).string(), store[i].name);
    }
    rows.push_back(found->second);
    store.set_pose(i, previous.poses[found->second].clone());
  }
  const Tensor index = torch::tensor(rows, torch::kInt64);
  const torch::Device device = gaussians::active_device();
  input.response.log_gains = previous.log_gains.index_select(0, index).to(device);
  if (previous.illumination.defined()) {
    input.response.illumination = previous.illumination.index_select(0, index).to(device);
  }
}

/// The Gaussians of the block, and those that its images may show.
gaussians::Gaussians surroundings(const gaussians::Gaussians& all, const RefinePlan& plan,
                                  const RefineTask& task, const mapping::KeyframeStore& store) {
  std::vector<gaussians::View> views;
  for (std::size_t i = 0; i < store.size(); ++i) views.push_back(store.view(i, 1));
  const gaussians::Gaussians map = gaussians::on_device(all, gaussians::active_device());
  const Tensor kept =
      (plan.partition.block_of(map.means) == task.block) | mapping::near_any_view(map.means, views);
  return gaussians::select(map, kept.nonzero().squeeze(1));
}

void limit_image_memory(RefineInput& input) {
  const double mib = static_cast<double>(input.images.store.image_bytes()) / (1 << 20);
  if (mib > input.config.mapping.online.image_memory_mib) {
    input.images.store.move_images(torch::kCPU);
  }
}

}  // namespace

RefineInput load_refine_input(const fs::path& folder, const RefinePlan& plan,
                              const RefineTask& task, ImageCache& images) {
  const torch::NoGradGuard no_grad;
  RefineInput input;
  input.config = load_recorded_run_config(plan.run / "resolved.yaml");
  input.medium = map_io::read_ply_medium(initial_map_file(folder));
  input.response.vignetting = plan.vignetting;
  input.images =
      load_posed_images(input.config, {.origin = plan.origin,
                                       .poses_of_images = given_poses(plan, block_of(plan, task)),
                                       .cache = &images});
  limit_image_memory(input);
  gaussians::Gaussians all;
  if (task.round == 0) {
    all = map_io::read_map(initial_map_file(folder)).gaussians;
  } else {
    RefineResult previous = previous_results(folder, plan, task);
    continue_from(previous, folder, input);
    input.steps = previous.steps;
    input.seconds = previous.seconds;
    all = std::move(previous.gaussians);
  }
  input.gaussians = surroundings(all, plan, task, input.images.store);
  return input;
}

}  // namespace apvi::runs
