// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/gaussian_inserter.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "core/random.hpp"
#include "gaussians/model/archive.hpp"
#include "mapping/density/random_insertion.hpp"
#include "mapping/density/seed_stream.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kExtentOverDepth = 1.1;
constexpr double kExtentMemory = 0.9;  // smoothing factor of the running mean over keyframes
constexpr double kMaxSeedScale = 3.0;  // of the remaining seeds when some are dropped

/// `count` of the seeds, evenly spread, enlarged to cover the same area.
Seeds thinned(const Seeds& seeds, std::int64_t count) {
  const double stride = static_cast<double>(seeds.size()) / static_cast<double>(count);
  Seeds fewer =
      seeds.select((torch::arange(0, count, torch::kFloat64) * stride).floor().to(torch::kInt64));
  fewer.radii_px = fewer.radii_px * std::min(kMaxSeedScale, std::sqrt(stride));
  return fewer;
}

Tensor anchored_to(std::size_t view, std::int64_t count) {
  return torch::full({count}, static_cast<std::int64_t>(view), torch::kInt64);
}

}  // namespace

GaussianInserter::GaussianInserter(const MapperOptions& options)
    : online_(options.online),
      sh_degree_(options.trainer.sh_degree),
      random_per_round_(options.trainer.densify.random_per_round),
      seed_(options.trainer.seed) {}

void GaussianInserter::insert(Seeds seeds, std::size_t view, const KeyframeStore& keyframes,
                              MapOptimizer& optimizer) {
  const double depth = kExtentOverDepth * seeds.depths.median().item<double>();
  extent_ = extent_ == 0.0 ? depth : kExtentMemory * extent_ + (1.0 - kExtentMemory) * depth;
  const std::int64_t granted = make_room(seeds.size(), keyframes, optimizer);
  if (granted <= 0) return;
  if (seeds.size() > granted) seeds = thinned(seeds, granted);
  const Map map = optimizer.full_map();
  const gaussians::Gaussians inserted = gaussians_from_seeds(
      seeds, keyframes, view, sh_degree_, map.medium, camera_response(map, keyframes, view, 1));
  optimizer.insert(inserted, anchored_to(view, inserted.size()));
}

void GaussianInserter::insert_random(std::size_t view, const KeyframeStore& keyframes,
                                     MapOptimizer& optimizer) const {
  const std::int64_t count = make_room(random_per_round_, keyframes, optimizer);
  if (count <= 0) return;
  Random random(derive_seed(seed_, Stream::insertion, static_cast<std::int64_t>(view)));
  const Map map = optimizer.full_map();
  const gaussians::Gaussians inserted =
      random_gaussians(map, keyframes, view, count, extent_, random);
  optimizer.insert(inserted, anchored_to(view, inserted.size()));
}

std::int64_t GaussianInserter::make_room(std::int64_t wanted, const KeyframeStore& keyframes,
                                         MapOptimizer& optimizer) const {
  const std::int64_t free = optimizer.room();
  const double share =
      online_.keyframe_budget_fraction * static_cast<double>(optimizer.max_gaussians());
  const std::int64_t granted = std::min(wanted, static_cast<std::int64_t>(std::ceil(share)));
  if (granted <= free || optimizer.size() == 0) return std::min(granted, free);
  const auto& views = keyframes.training();
  const auto recent = std::min(views.size(), static_cast<std::size_t>(online_.recent_keyframes));
  const auto oldest_recent = static_cast<std::int64_t>(views[views.size() - recent]);
  const Tensor old = optimizer.anchors() < oldest_recent;
  const std::int64_t count = std::min(granted - free, old.sum().item<std::int64_t>());
  optimizer.prune_least_important(count, old);
  return std::min(optimizer.max_gaussians() - optimizer.size(), granted);
}

void GaussianInserter::save(torch::serialize::OutputArchive& archive) const {
  archive.write("extent", c10::IValue(extent_));
}

void GaussianInserter::load(torch::serialize::InputArchive& archive) {
  extent_ = gaussians::read_double(archive, "extent");
}

}  // namespace apvi::mapping
