// SPDX-License-Identifier: BSD-3-Clause
// Where the mapper's Gaussians come from.
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "apvi/core/log.hpp"
#include "apvi/core/random.hpp"
#include "apvi/mapping/initial_map.hpp"
#include "apvi/mapping/mapper.hpp"
#include "apvi/mapping/open_water.hpp"
#include "apvi/mapping/quadtree_insertion.hpp"
#include "apvi/mapping/random_insertion.hpp"
#include "apvi/splat/device.hpp"
#include "apvi/splat/render.hpp"
#include "neighbours.hpp"
#include "seed_stream.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kExtentOverDepth = 1.1;
constexpr double kExtentMemory = 0.9;   // of the mean over keyframes
constexpr double kLeastRadiusPx = 1.0;  // of a Gaussian at a sparse point
constexpr double kMostRadiusPx = 8.0;
constexpr std::int64_t kMostPoints = 4096;  // sparse ones that are remembered
constexpr double kMostWidened = 3.0;        // of seeds that stand for more than their own

double finite_median(const Tensor& values) {
  return values.median().item<double>();
}

// Half of the distance to the nearest neighbours in the picture, in pixels.
Tensor spacing(const Tensor& pixels) {
  const Tensor flat = torch::cat({pixels, torch::zeros({pixels.size(0), 1}, pixels.options())}, 1);
  const Tensor distance = neighbour_distance(flat.to(torch::kFloat32)).to(torch::kFloat64);
  return (0.5 * distance).clamp(kLeastRadiusPx, kMostRadiusPx);
}

/// So many of them, evenly over the picture, and as much larger as they are fewer.
Seeds thinned(const Seeds& seeds, std::int64_t count) {
  const double each = static_cast<double>(seeds.size()) / static_cast<double>(count);
  Seeds fewer =
      seeds.select((torch::arange(0, count, torch::kFloat64) * each).floor().to(torch::kInt64));
  fewer.radii_px = fewer.radii_px * std::min(kMostWidened, std::sqrt(each));
  return fewer;
}

Tensor finite_rows(const Tensor& positions) {
  return torch::isfinite(positions).all(1);
}

}  // namespace

// Points that are new, in view and known well; those that were ranged need no id.
Seeds Mapper::point_seeds(std::size_t view, const MapperInput& input) {
  const splat::View camera = keyframes_.view(view, 1);
  std::map<std::int64_t, bool> known;
  Tensor positions = torch::empty({0, 3}, torch::kFloat64);
  const SparsePoints& points = input.points;
  if (points.ids.defined() && points.ids.size(0) > 0) {
    const Tensor placed = drift_.points_in_map(points.positions);
    const SeenPoints seen = project(camera, placed);
    const Tensor good = finite_rows(placed) & seen.in_view &
                        (points.sigmas <= options_.online.point_sigma * seen.depths);
    Tensor fresh = torch::zeros({points.ids.size(0)}, torch::kBool);
    const auto id = points.ids.accessor<std::int64_t, 1>();
    const auto is_good = good.accessor<bool, 1>();
    auto is_fresh = fresh.accessor<bool, 1>();
    for (std::int64_t i = 0; i < id.size(0); ++i) {
      const auto before = known_.find(id[i]);
      const bool inserted = before != known_.end() && before->second;
      is_fresh[i] = is_good[i] && !inserted && known.count(id[i]) == 0;
      known[id[i]] = inserted || is_good[i];
    }
    positions = placed.index({fresh});
  }
  known_ = std::move(known);
  if (input.depth_samples.defined() && input.depth_samples.size(0) > 0) {
    const Tensor samples = drift_.points_in_map(input.depth_samples);
    const Tensor usable = finite_rows(samples) & project(camera, samples).in_view;
    positions = torch::cat({positions, samples.index({usable})});
  }
  points_ = torch::cat({points_, positions});
  if (points_.size(0) > kMostPoints) {
    points_ = points_.slice(0, points_.size(0) - kMostPoints).clone();
  }
  const SeenPoints seen = project(camera, positions);
  return {.pixels = seen.pixels,
          .depths = seen.depths,
          .radii_px = spacing(seen.pixels),
          .opacities = torch::full({positions.size(0)}, options_.online.opacity, torch::kFloat64)};
}

void Mapper::insert_points(std::size_t view, const MapperInput& input) {
  const auto entry = times_.enter("insertion");
  const Seeds seeds = point_seeds(view, input);
  if (seeds.size() > 0) {
    within_memory([&] { insert(view, seeds); });
  }
}

void Mapper::fill_from_depth(std::size_t view) {
  if (!keyframes_[view].image.defined()) return;
  DepthRequest request;
  if (learner_) request.medium = learner_->medium();
  // Over a baseline as short as theirs nothing knows better than odometry how they stand.
  for (const std::size_t i : neighbours(keyframes_, view, insertion_depth_.views)) {
    splat::View camera = keyframes_.view(i, 1);
    camera.T_camera_world = drift_.in_map(view, drift_.in_odometry(i, camera.T_camera_world));
    request.views.push_back({to_grey(keyframes_[i].image.to(splat::active_device())), camera});
  }
  DepthEstimate estimate;
  {
    const auto entry = times_.enter("depth");
    estimate = estimate_depth(request, insertion_depth_);
  }
  if (estimate.verdict != DepthVerdict::estimated) return;
  const auto entry = times_.enter("filling");
  const splat::View camera = keyframes_.view(view, 1);
  if (learner_ && !options_.trainer.lamp && options_.online.free_space > 0.0) {
    const Tensor gone = in_free_space(estimate, camera, learner_->whole_map().gaussians.means,
                                      options_.online.free_space);
    if (gone.any().item<bool>()) learner_->remove(gone);
  }
  const Tensor picture = keyframes_.image(view, 1, splat::active_device());
  Tensor drawn = torch::zeros_like(picture);
  Tensor alpha = torch::zeros({picture.size(0), picture.size(1)}, picture.options());
  if (learner_) {
    const Map map = learner_->whole_map();
    const Picture shown = take_picture(map, camera);
    const Tensor response = camera_response(map, keyframes_, view, 1);
    drawn = (shown.as_seen * response).clamp_max(1.0);
    alpha = shown.alpha;
    const Tensor water = water_alone(map, camera.intrinsics);
    if (water.defined()) {  // which needs no surface
      const Tensor seen = (water * response).clamp_max(1.0);
      alpha = alpha.masked_fill(open_water(picture / response, seen / response), 1.0);
    }
  }
  const SeenPoints seen = project(camera, points_);
  const Tensor pixels = seen.pixels.index({seen.in_view});
  const Tensor which = blocks_to_fill(estimate, pixels, drawn, alpha, picture, options_.online);
  const Seeds seeds = seeds_of_blocks(estimate, which, options_.online.opacity);
  log::debug("{}: depth of {} of {} blocks is believed, {} are filled", keyframes_[view].name,
             estimate.confident.sum().item<std::int64_t>(), estimate.blocks.size(), seeds.size());
  if (seeds.size() > 0) insert(view, seeds);
}

void Mapper::insert_random(std::size_t view) {
  if (!learner_) return;
  const auto entry = times_.enter("insertion");
  const std::int64_t count = make_room(options_.trainer.densify.random_per_round);
  if (count <= 0) return;
  Random random(seed_of(options_.trainer.seed, Stream::insertion, static_cast<std::int64_t>(view)));
  const Map map = learner_->whole_map();
  learner_->insert(random_gaussians(map, keyframes_, view, count, extent_, random),
                   torch::full({count}, static_cast<std::int64_t>(view), torch::kInt64));
}

void Mapper::insert(std::size_t view, Seeds seeds) {
  const double depth = kExtentOverDepth * finite_median(seeds.depths);
  extent_ = extent_ == 0.0 ? depth : kExtentMemory * extent_ + (1.0 - kExtentMemory) * depth;
  const std::int64_t granted = make_room(seeds.size());
  if (granted <= 0) return;
  if (seeds.size() > granted) seeds = thinned(seeds, granted);
  const std::optional<splat::Medium> medium = learner_ ? learner_->medium() : std::nullopt;
  const Tensor response =
      learner_ ? camera_response(learner_->whole_map(), keyframes_, view, 1) : Tensor();
  const splat::Gaussians made =
      gaussians_at(seeds, keyframes_, view, options_.trainer.sh_degree, medium, response);
  const Tensor anchors = torch::full({made.size()}, static_cast<std::int64_t>(view), torch::kInt64);
  if (!learner_) {
    learner_.emplace(splat::Gaussians::empty(options_.trainer.sh_degree, torch::kFloat32),
                     options_.trainer, keyframes_.size());
  }
  learner_->insert(made, anchors);
}

std::int64_t Mapper::room() const {
  return std::max<std::int64_t>(0, options_.trainer.densify.max_gaussians - size());
}

// One keyframe gets a share of the map, so that some is left for those that come, and in a full map
// the place of the older Gaussians that views miss least.
std::int64_t Mapper::make_room(std::int64_t wanted) {
  const std::int64_t most = options_.trainer.densify.max_gaussians;
  const std::int64_t free = room();
  const double share = options_.online.keyframe_share * static_cast<double>(most);
  const std::int64_t granted = std::min(wanted, static_cast<std::int64_t>(std::ceil(share)));
  if (granted <= free || !learner_ || size() == 0) return std::min(granted, free);
  const auto& views = keyframes_.training();
  const auto recent =
      std::min(views.size(), static_cast<std::size_t>(options_.online.recent_keyframes));
  const auto oldest_recent = static_cast<std::int64_t>(views[views.size() - recent]);
  const Tensor old = learner_->anchors() < oldest_recent;
  const std::int64_t count = std::min(granted - free, old.sum().item<std::int64_t>());
  learner_->drop_least(count, old);
  return std::min(most - size(), granted);
}

}  // namespace apvi::mapping
