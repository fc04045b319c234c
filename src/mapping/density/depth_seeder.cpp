// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/depth_seeder.hpp"

#include <torch/torch.h>

#include "apvi/core/log.hpp"
#include "core/stopwatch.hpp"
#include "gaussians/device.hpp"
#include "mapping/density/neighbors.hpp"
#include "mapping/density/quadtree_insertion.hpp"
#include "mapping/medium/open_water.hpp"
#include "mapping/training/robust_weights.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kUniformPatchSigma = 1e3;  // disables the patch's color weights

/// Lamp-lit images are noisy, so selecting the best views and weighting patch pixels by color picks
/// noise and costs more Gaussians than it gains behind edges. Medium estimation keeps the
/// selection: it only uses mapped surfaces and averages their normals.
depth::DepthOptions depth_options_with_lamp(depth::DepthOptions depth) {
  depth.best_views_fraction = 1.0;
  depth.patch_intensity_sigma = kUniformPatchSigma;
  return depth;
}

}  // namespace

DepthSeeder::DepthSeeder(const MapperOptions& options)
    : depth_(options.trainer.lamps.empty() ? options.depth
                                           : depth_options_with_lamp(options.depth)),
      options_(options.online),
      clears_free_space_(options.trainer.lamps.empty() &&
                         options.online.free_space_depth_ratio > 0.0) {}

// Over such a short baseline, relative poses from odometry are the most accurate.
depth::DepthRequest DepthSeeder::request(std::size_t view, const KeyframeStore& keyframes,
                                         const KeyframePoses& poses,
                                         const MapOptimizer& optimizer) const {
  depth::DepthRequest request;
  request.medium = optimizer.medium();
  for (const std::size_t i : neighbors(keyframes, view, depth_.views)) {
    gaussians::View camera = keyframes.view(i, 1);
    camera.T_camera_world = poses.relative_pose(i, view, keyframes);
    request.views.push_back(
        {depth::to_gray(keyframes.pixels(i).to(gaussians::active_device())), camera});
  }
  return request;
}

depth::DepthEstimate DepthSeeder::estimate(const depth::DepthRequest& request,
                                           const Tensor& scene) {
  const TimedScope scope(estimation_s_);
  depth::DepthEstimate estimate = depth::estimate_depth(request, depth_);
  if (scene.defined() && estimate.status == depth::DepthStatus::estimated) {
    estimate.confident = estimate.confident & blocks_in_scene(scene, estimate.blocks);
  }
  return estimate;
}

void DepthSeeder::clear_free_space(const depth::DepthEstimate& estimate,
                                   const gaussians::View& camera, MapOptimizer& optimizer) const {
  if (!clears_free_space_) return;
  const Tensor occluding =
      in_free_space(estimate, camera, optimizer.map().means, options_.free_space_depth_ratio);
  if (occluding.any().item<bool>()) optimizer.remove(occluding);
}

Seeds DepthSeeder::seeds(const depth::DepthEstimate& estimate, std::size_t view,
                         const KeyframeStore& keyframes, const MapOptimizer& optimizer,
                         const Tensor& points) const {
  const Map map = optimizer.full_map();
  const gaussians::View camera = keyframes.view(view, 1);
  const Tensor image = keyframes.image(view, 1, gaussians::active_device());
  const MapRendering rendering = render_map(map, camera);
  const Tensor response = camera_response(map, keyframes, view, 1);
  Tensor rendered = (rendering.color * response).clamp_max(1.0);
  Tensor alpha = rendering.alpha;
  const Tensor water = render_open_water(map, camera.intrinsics);
  if (water.defined()) {  // open water needs no Gaussians
    const Tensor seen = (water * response).clamp_max(1.0);
    alpha = alpha.masked_fill(open_water(image / response, seen / response), 1.0);
  }
  const auto leave = [&](const Tensor& pixels) {
    alpha = alpha.masked_fill(pixels, 1.0);
    rendered = torch::where(pixels.unsqueeze(2), image, rendered);
  };
  const Tensor scene = keyframes.scene(view, 1, image.device());
  if (scene.defined()) leave(scene.logical_not());
  if (optimizer.robust_weights() != nullptr) {  // nor does what moves
    leave(optimizer.robust_weights()->outliers({.rendered = map.tone_curve.encode(rendered),
                                                .alpha = rendering.alpha,
                                                .image = map.tone_curve.encode(image)}));
  }
  const ProjectedPoints seen = project(camera, points);
  const Tensor pixels = seen.pixels.index({seen.in_view});
  const Tensor depths = insertion_depths(estimate, options_.insertion_depth);
  const Tensor which = blocks_to_fill(estimate, depths, pixels, rendered, alpha, image, options_);
  Seeds seeds = seeds_from_blocks(estimate, depths, which, options_.initial_opacity);
  log::debug("{}: depth accepted in {} of {} blocks, {} seeded", keyframes[view].name,
             estimate.confident.sum().item<std::int64_t>(), estimate.blocks.size(), seeds.size());
  return seeds;
}

}  // namespace apvi::mapping
