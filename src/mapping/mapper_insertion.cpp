// SPDX-License-Identifier: BSD-3-Clause
// Mapper: insertion of Gaussians.
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "apvi/core/log.hpp"
#include "core/random.hpp"
#include "gaussians/device.hpp"
#include "gaussians/render/render.hpp"
#include "mapping/density/initial_map.hpp"
#include "mapping/density/neighbors.hpp"
#include "mapping/density/quadtree_insertion.hpp"
#include "mapping/density/random_insertion.hpp"
#include "mapping/density/seed_stream.hpp"
#include "mapping/mapper.hpp"
#include "mapping/medium/open_water.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kExtentOverDepth = 1.1;
constexpr double kExtentMemory = 0.9;  // smoothing factor of the running mean over keyframes
constexpr double kMinRadius_px = 1.0;  // of a Gaussian at a sparse point
constexpr double kMaxRadius_px = 8.0;
constexpr std::int64_t kMaxSparsePoints = 4096;  // kept to skip depth blocks that contain one
constexpr double kMaxSeedScale = 3.0;            // of the remaining seeds when some are dropped

double finite_median(const Tensor& values) {
  return values.median().item<double>();
}

// Half of the distance to the nearest neighbors in the image [px].
Tensor spacing(const Tensor& pixels) {
  const Tensor flat = torch::cat({pixels, torch::zeros({pixels.size(0), 1}, pixels.options())}, 1);
  const Tensor distance = neighbor_distance(flat.to(torch::kFloat32)).to(torch::kFloat64);
  return (0.5 * distance).clamp(kMinRadius_px, kMaxRadius_px);
}

/// `count` of the seeds, evenly spread, enlarged to cover the same area.
Seeds thinned(const Seeds& seeds, std::int64_t count) {
  const double stride = static_cast<double>(seeds.size()) / static_cast<double>(count);
  Seeds fewer =
      seeds.select((torch::arange(0, count, torch::kFloat64) * stride).floor().to(torch::kInt64));
  fewer.radii_px = fewer.radii_px * std::min(kMaxSeedScale, std::sqrt(stride));
  return fewer;
}

Tensor finite_rows(const Tensor& positions) {
  return torch::isfinite(positions).all(1);
}

}  // namespace

// Seeds of new, visible and accurate sparse points, and of all visible range samples.
Seeds Mapper::point_seeds(std::size_t view, const MapperInput& input) {
  const gaussians::View camera = keyframes_.view(view, 1);
  std::map<std::int64_t, bool> known;
  Tensor positions = torch::empty({0, 3}, torch::kFloat64);
  const SparsePoints& points = input.points;
  if (points.ids.defined() && points.ids.size(0) > 0) {
    const Tensor placed = map_odom_.points_in_map(points.positions);
    const ProjectedPoints seen = project(camera, placed);
    const Tensor good = finite_rows(placed) & seen.in_view &
                        (points.sigmas <= options_.online.max_relative_point_sigma * seen.depths);
    Tensor fresh = torch::zeros({points.ids.size(0)}, torch::kBool);
    const auto id = points.ids.accessor<std::int64_t, 1>();
    const auto is_good = good.accessor<bool, 1>();
    auto is_fresh = fresh.accessor<bool, 1>();
    for (std::int64_t i = 0; i < id.size(0); ++i) {
      const auto before = inserted_points_.find(id[i]);
      const bool inserted = before != inserted_points_.end() && before->second;
      is_fresh[i] = is_good[i] && !inserted && known.count(id[i]) == 0;
      known[id[i]] = inserted || is_good[i];
    }
    positions = placed.index({fresh});
  }
  inserted_points_ = std::move(known);
  if (input.depth_samples.defined() && input.depth_samples.size(0) > 0) {
    const Tensor samples = map_odom_.points_in_map(input.depth_samples);
    const Tensor usable = finite_rows(samples) & project(camera, samples).in_view;
    positions = torch::cat({positions, samples.index({usable})});
  }
  points_ = torch::cat({points_, positions});
  if (points_.size(0) > kMaxSparsePoints) {
    points_ = points_.slice(0, points_.size(0) - kMaxSparsePoints).clone();
  }
  const ProjectedPoints seen = project(camera, positions);
  return {.pixels = seen.pixels,
          .depths = seen.depths,
          .radii_px = spacing(seen.pixels),
          .opacities =
              torch::full({positions.size(0)}, options_.online.initial_opacity, torch::kFloat64)};
}

void Mapper::insert_points(std::size_t view, const MapperInput& input) {
  const auto entry = times_.scope("insertion");
  const Seeds seeds = point_seeds(view, input);
  if (seeds.size() > 0) {
    retry_on_oom([&] { insert(view, seeds); });
  }
}

void Mapper::insert_from_depth(std::size_t view) {
  if (!keyframes_[view].image.defined()) return;
  depth::DepthRequest request;
  if (optimizer_) request.medium = optimizer_->medium();
  // Over such a short baseline, relative poses from odometry are the most accurate.
  for (const std::size_t i : neighbors(keyframes_, view, insertion_depth_.views)) {
    gaussians::View camera = keyframes_.view(i, 1);
    camera.T_camera_world =
        map_odom_.pose_in_map(view, map_odom_.pose_in_odometry(i, camera.T_camera_world));
    request.views.push_back(
        {depth::to_gray(keyframes_[i].image.to(gaussians::active_device())), camera});
  }
  depth::DepthEstimate estimate;
  {
    const auto entry = times_.scope("depth");
    const Stopwatch watch;
    estimate = depth::estimate_depth(request, insertion_depth_);
    depth_s_ += watch.seconds();
  }
  if (estimate.status != depth::DepthStatus::estimated) return;
  const auto entry = times_.scope("filling");
  const gaussians::View camera = keyframes_.view(view, 1);
  if (optimizer_ && !options_.trainer.lamp && options_.online.free_space_depth_ratio > 0.0) {
    const Tensor occluding = in_free_space(estimate, camera, optimizer_->full_map().gaussians.means,
                                           options_.online.free_space_depth_ratio);
    if (occluding.any().item<bool>()) optimizer_->remove(occluding);
  }
  const Tensor image = keyframes_.image(view, 1, gaussians::active_device());
  Tensor rendered = torch::zeros_like(image);
  Tensor alpha = torch::zeros({image.size(0), image.size(1)}, image.options());
  if (optimizer_) {
    const Map map = optimizer_->full_map();
    const MapRendering rendering = render_map(map, camera);
    const Tensor response = camera_response(map, keyframes_, view, 1);
    rendered = (rendering.color * response).clamp_max(1.0);
    alpha = rendering.alpha;
    const Tensor water = render_open_water(map, camera.intrinsics);
    if (water.defined()) {  // open water needs no Gaussians
      const Tensor seen = (water * response).clamp_max(1.0);
      alpha = alpha.masked_fill(open_water(image / response, seen / response), 1.0);
    }
  }
  const ProjectedPoints seen = project(camera, points_);
  const Tensor pixels = seen.pixels.index({seen.in_view});
  const Tensor which = blocks_to_fill(estimate, pixels, rendered, alpha, image, options_.online);
  const Seeds seeds = seeds_from_blocks(estimate, which, options_.online);
  log::debug("{}: depth accepted in {} of {} blocks, {} seeded", keyframes_[view].name,
             estimate.confident.sum().item<std::int64_t>(), estimate.blocks.size(), seeds.size());
  if (seeds.size() > 0) insert(view, seeds);
}

void Mapper::insert_random(std::size_t view) {
  if (!optimizer_) return;
  const auto entry = times_.scope("insertion");
  const std::int64_t count = make_room(options_.trainer.densify.random_per_round);
  if (count <= 0) return;
  Random random(
      derive_seed(options_.trainer.seed, Stream::insertion, static_cast<std::int64_t>(view)));
  const Map map = optimizer_->full_map();
  optimizer_->insert(random_gaussians(map, keyframes_, view, count, extent_, random),
                     torch::full({count}, static_cast<std::int64_t>(view), torch::kInt64));
}

void Mapper::insert(std::size_t view, Seeds seeds) {
  const double depth = kExtentOverDepth * finite_median(seeds.depths);
  extent_ = extent_ == 0.0 ? depth : kExtentMemory * extent_ + (1.0 - kExtentMemory) * depth;
  const std::int64_t granted = make_room(seeds.size());
  if (granted <= 0) return;
  if (seeds.size() > granted) seeds = thinned(seeds, granted);
  const std::optional<medium::Medium> medium = optimizer_ ? optimizer_->medium() : std::nullopt;
  const Tensor response =
      optimizer_ ? camera_response(optimizer_->full_map(), keyframes_, view, 1) : Tensor();
  const gaussians::Gaussians inserted =
      gaussians_from_seeds(seeds, keyframes_, view, options_.trainer.sh_degree, medium, response);
  const Tensor anchors =
      torch::full({inserted.size()}, static_cast<std::int64_t>(view), torch::kInt64);
  if (!optimizer_) {
    optimizer_.emplace(gaussians::Gaussians::empty(options_.trainer.sh_degree, torch::kFloat32),
                       options_.trainer, keyframes_.size());
  }
  optimizer_->insert(inserted, anchors);
}

std::int64_t Mapper::room() const {
  return std::max<std::int64_t>(0, options_.trainer.densify.max_gaussians - size());
}

// Each keyframe gets at most a share of the map's capacity, which leaves room for later keyframes.
// In a full map the least important Gaussians of older keyframes are pruned.
std::int64_t Mapper::make_room(std::int64_t wanted) {
  const std::int64_t max_gaussians = options_.trainer.densify.max_gaussians;
  const std::int64_t free = room();
  const double share =
      options_.online.keyframe_budget_fraction * static_cast<double>(max_gaussians);
  const std::int64_t granted = std::min(wanted, static_cast<std::int64_t>(std::ceil(share)));
  if (granted <= free || !optimizer_ || size() == 0) return std::min(granted, free);
  const auto& views = keyframes_.training();
  const auto recent =
      std::min(views.size(), static_cast<std::size_t>(options_.online.recent_keyframes));
  const auto oldest_recent = static_cast<std::int64_t>(views[views.size() - recent]);
  const Tensor old = optimizer_->anchors() < oldest_recent;
  const std::int64_t count = std::min(granted - free, old.sum().item<std::int64_t>());
  optimizer_->prune_least_important(count, old);
  return std::min(max_gaussians - size(), granted);
}

}  // namespace apvi::mapping
