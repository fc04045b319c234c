// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/point_seeder.hpp"

#include <torch/torch.h>

#include <utility>

#include "mapping/density/initial_map.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kMinRadius_px = 1.0;  // of a Gaussian at a sparse point
constexpr double kMaxRadius_px = 8.0;
constexpr std::int64_t kMaxPositions = 4096;  // kept to skip depth blocks that contain one

// Half of the distance to the nearest neighbors in the image [px].
Tensor spacing(const Tensor& pixels) {
  const Tensor flat = torch::cat({pixels, torch::zeros({pixels.size(0), 1}, pixels.options())}, 1);
  const Tensor distance = neighbor_distance(flat.to(torch::kFloat32)).to(torch::kFloat64);
  return (0.5 * distance).clamp(kMinRadius_px, kMaxRadius_px);
}

Tensor finite_rows(const Tensor& positions) {
  return torch::isfinite(positions).all(1);
}

}  // namespace

PointSeeder::PointSeeder(const OnlineOptions& options)
    : max_relative_sigma_(options.max_relative_point_sigma),
      opacity_(options.initial_opacity),
      positions_(torch::empty({0, 3}, torch::kFloat64)) {}

// Positions [n,3] of the points that are new, visible and accurate.
Tensor PointSeeder::new_points(const gaussians::View& camera, const SparsePoints& points) {
  std::map<std::int64_t, bool> known;
  Tensor positions = torch::empty({0, 3}, torch::kFloat64);
  if (points.ids.defined() && points.ids.size(0) > 0) {
    const ProjectedPoints seen = project(camera, points.positions);
    const Tensor good = finite_rows(points.positions) & seen.in_view &
                        (points.sigmas <= max_relative_sigma_ * seen.depths);
    Tensor fresh = torch::zeros({points.ids.size(0)}, torch::kBool);
    const auto id = points.ids.accessor<std::int64_t, 1>();
    const auto is_good = good.accessor<bool, 1>();
    auto is_fresh = fresh.accessor<bool, 1>();
    for (std::int64_t i = 0; i < id.size(0); ++i) {
      const auto before = seeded_.find(id[i]);
      const bool seeded = before != seeded_.end() && before->second;
      is_fresh[i] = is_good[i] && !seeded && known.count(id[i]) == 0;
      known[id[i]] = seeded || is_good[i];
    }
    positions = points.positions.index({fresh});
  }
  seeded_ = std::move(known);
  return positions;
}

Seeds PointSeeder::seeds(const gaussians::View& camera, const SparsePoints& points,
                         const Tensor& samples) {
  Tensor positions = new_points(camera, points);
  if (samples.defined() && samples.size(0) > 0) {
    const Tensor usable = finite_rows(samples) & project(camera, samples).in_view;
    positions = torch::cat({positions, samples.index({usable})});
  }
  positions_ = torch::cat({positions_, positions});
  if (positions_.size(0) > kMaxPositions) {
    positions_ = positions_.slice(0, positions_.size(0) - kMaxPositions).clone();
  }
  const ProjectedPoints seen = project(camera, positions);
  return {.pixels = seen.pixels,
          .depths = seen.depths,
          .radii_px = spacing(seen.pixels),
          .opacities = torch::full({positions.size(0)}, opacity_, torch::kFloat64)};
}

void PointSeeder::change_scale(const gaussians::ScaleChange& change) {
  const Tensor& center = change.center;
  positions_ = center + change.scale * (positions_ - center);
}

void PointSeeder::save(torch::serialize::OutputArchive& archive) const {
  archive.write("points", positions_);
}

void PointSeeder::load(torch::serialize::InputArchive& archive) {
  archive.read("points", positions_);
}

}  // namespace apvi::mapping
