// SPDX-License-Identifier: BSD-3-Clause
#include "runs/refine/refine_planning.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <set>
#include <system_error>
#include <utility>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "core/status_line.hpp"
#include "gaussians/device.hpp"
#include "gaussians/model/rows.hpp"
#include "map_io/map_file.hpp"
#include "mapping/blocks/block_views.hpp"
#include "runs/maps/local_origin.hpp"
#include "runs/maps/posed_images.hpp"
#include "runs/maps/stored_map.hpp"
#include "runs/merge/merge_input.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using torch::Tensor;

constexpr std::size_t kMaxImagesPerBlock = 600;  // by default
constexpr double kMinShare = 0.1;  // of the surface in an image, for the image to train a block

std::vector<ImagePose> training_images(const MergeSession& session) {
  std::vector<ImagePose> images = list_posed_images(session.config, session.poses);
  std::erase_if(images, [](const ImagePose& image) { return image.held_out; });
  return images;
}

std::vector<gaussians::View> views_of(const std::vector<ImagePose>& images,
                                      const MergeSession& session) {
  Trajectory poses;
  for (const ImagePose& image : images) poses.poses.push_back(image.pose);
  const CameraMount mount = mount_of_run(session.config);
  std::vector<gaussians::View> views;
  for (const StampedPose& pose : to_local(std::move(poses), session.map.origin).poses) {
    views.push_back(view_at(pose.T_world_body, mount));
  }
  return views;
}

mapping::Map drawable(const map_io::MapFile& file) {
  mapping::Map map;
  map.gaussians = gaussians::on_device(file.gaussians, gaussians::active_device());
  map.antialiased = file.antialiased;
  return map;
}

/// The surface that each view shows: [n,3] each.
std::vector<Tensor> shown_surfaces(const MergeSession& session,
                                   const std::vector<gaussians::View>& views) {
  const mapping::Map map = drawable(session.map);
  StatusLine status("finding what the images show");
  std::vector<Tensor> surfaces;
  for (const gaussians::View& view : views) {
    surfaces.push_back(mapping::surface_points(map, view));
    status.update(static_cast<double>(surfaces.size()) / static_cast<double>(views.size()), "");
  }
  return surfaces;
}

int block_count(const RefinePlanOptions& options, std::size_t images) {
  if (options.blocks > 0) return options.blocks;
  const std::size_t needed = (images + kMaxImagesPerBlock - 1) / kMaxImagesPerBlock;
  return std::max(options.min_blocks, static_cast<int>(needed));
}

/// Block of the camera itself, for an image that shows no surface.
int block_of_camera(const mapping::BlockPartition& partition, const gaussians::View& view) {
  const Tensor center = mapping::camera_center(view.T_camera_world).unsqueeze(0);
  return static_cast<int>(partition.block_of(center).item<std::int64_t>());
}

/// Assigns the images; `shares` [images, blocks] of what they show.
void assign(RefinePlan& plan, const Tensor& shares) {
  const auto share = shares.accessor<double, 2>();
  const auto blocks = static_cast<std::int64_t>(plan.blocks.size());
  for (std::int64_t b = 0; b < blocks; ++b) {
    // A block that no image shows much of is trained by all that show any of it.
    const bool small = shares.select(1, b).max().item<double>() < kMinShare;
    const double least = small ? 0.0 : kMinShare;
    RefineBlock& block = plan.blocks[static_cast<std::size_t>(b)];
    std::set<int> seen = {static_cast<int>(b)};
    for (std::int64_t i = 0; i < shares.size(0); ++i) {
      const bool is_owner = plan.images[static_cast<std::size_t>(i)].owner == b;
      if (!is_owner && !(share[i][b] > 0.0 && share[i][b] >= least)) continue;
      block.images.push_back(static_cast<std::size_t>(i));
      for (std::int64_t k = 0; k < blocks; ++k) {
        if (share[i][k] > 0.0) seen.insert(static_cast<int>(k));
      }
    }
    block.neighbors.assign(seen.begin(), seen.end());
  }
}

void assign_images(RefinePlan& plan, const std::vector<ImagePose>& images,
                   const std::vector<gaussians::View>& views, const std::vector<Tensor>& surfaces) {
  std::vector<Tensor> rows;
  for (std::size_t i = 0; i < views.size(); ++i) {
    rows.push_back(mapping::block_shares(plan.partition, surfaces[i]));
    const int owner = surfaces[i].size(0) > 0
                          ? static_cast<int>(rows.back().argmax().item<std::int64_t>())
                          : block_of_camera(plan.partition, views[i]);
    plan.images.push_back(
        {.image = images[i].image, .taken = images[i].pose.stamp, .owner = owner});
  }
  plan.blocks.resize(static_cast<std::size_t>(plan.partition.size()));
  assign(plan, torch::stack(rows));
}

void create_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) fail_run("{}: {}", folder.string(), error.message());
}

}  // namespace

RefinePlan make_plan(const fs::path& run, const fs::path& folder,
                     const RefinePlanOptions& options) {
  const torch::NoGradGuard no_grad;
  const MergeSession session = load_merge_session(run);
  const std::vector<ImagePose> images = training_images(session);
  if (images.empty()) {
    fail_input("{}: its recording {} has no training images with poses", run.string(),
               session.config.dataset.path);
  }
  const std::vector<gaussians::View> views = views_of(images, session);
  const std::vector<Tensor> surfaces = shown_surfaces(session, views);
  const Tensor all = torch::cat(surfaces);
  if (all.size(0) == 0) fail_input("{}: none of its images shows its map", run.string());
  const int configured = session.config.mapping.trainer.densify.max_gaussians;
  RefinePlan plan{.run = fs::absolute(run),
                  .rounds = options.rounds,
                  .steps_per_image = options.steps_per_image,
                  .max_gaussians = options.max_gaussians > 0 ? options.max_gaussians : configured,
                  .partition = mapping::BlockPartition::of(all, block_count(options, views.size())),
                  .vignetting = session.map.vignetting,
                  .tone_curve = session.map.tone_curve,
                  .origin = session.map.origin};
  assign_images(plan, images, views, surfaces);
  log::info("{} training images in {} blocks, {} rounds", plan.images.size(), plan.blocks.size(),
            plan.rounds);
  create_folder(refine_folder(folder));
  map_io::write_map(initial_map_file(folder), session.map);
  write_plan(folder, plan);
  return plan;
}

}  // namespace apvi::runs
