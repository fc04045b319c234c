// SPDX-License-Identifier: BSD-3-Clause
#include "change/surface_cells.hpp"

#include <torch/torch.h>

#include <algorithm>

namespace apvi::change {
namespace {

using torch::Tensor;

constexpr std::int64_t kBits = 21;
constexpr std::int64_t kMiddle = std::int64_t{1} << (kBits - 1);
constexpr std::int64_t kMinViews = 3;
constexpr double kSigmas = 3.0;
constexpr double kMad = 1.4826;  // from median absolute to standard deviation of a normal law
constexpr double kMinDeviation = 0.15;  // of a cell, within which surfaces are curved
constexpr double kPrior = 3.0;          // views that the common deviation counts for in a cell
constexpr std::size_t kBatch = 16;      // views between reductions of their points

/// Sums over points by cell: keys ascending, values with a last column of counts.
struct Sums {
  Tensor keys;
  Tensor values;
};

Sums reduced(const Sums& sums) {
  const auto [keys, inverse, counts] = torch::_unique2(sums.keys, true, true);
  const Tensor values = torch::zeros({keys.size(0), sums.values.size(1)}, sums.values.options());
  return {keys, values.index_add_(0, inverse, sums.values)};
}

/// Columns: point, normal, color, details, variance of depth, one.
Sums sums_of(const SurfaceView& view, double cell_m) {
  const SurfacePixels seen = surface_pixels(view);
  const auto [R, t] = camera_pose(view.view, seen.points);
  const Tensor world = (seen.points - t).mm(R);
  const Tensor planes = view.planes.index_select(0, seen.pixels);
  const Tensor normals = -(planes / planes.norm(2, 1, true)).mm(R);
  const Tensor values = torch::cat({world, normals, view.color.index_select(0, seen.pixels),
                                    view.detail.index_select(0, seen.pixels),
                                    view.spread.index_select(0, seen.pixels).square().unsqueeze(1),
                                    torch::ones_like(world.slice(1, 0, 1))},
                                   1);
  return reduced({cell_keys(world, cell_m), values.to(torch::kFloat64)});
}

Sums joined(const std::vector<Sums>& parts) {
  std::vector<Tensor> keys;
  std::vector<Tensor> values;
  for (const Sums& part : parts) {
    keys.push_back(part.keys);
    values.push_back(part.values);
  }
  return reduced({torch::cat(keys), torch::cat(values)});
}

SurfaceCells gathered(const std::vector<SurfaceView>& views, double cell_m) {
  std::vector<Sums> parts;
  for (const SurfaceView& view : views) {
    parts.push_back(sums_of(view, cell_m));
    if (parts.size() == kBatch) parts = {joined(parts)};
  }
  const Sums all = joined(parts);
  const Tensor mean = (all.values / all.values.slice(1, -1)).to(torch::kFloat32);
  const Tensor normals = mean.slice(1, 3, 6);
  return {.cell_m = cell_m,
          .keys = all.keys,
          .points = mean.slice(1, 0, 3).contiguous(),
          .normals = normals / normals.norm(2, 1, true).clamp_min(1e-6),
          .color = mean.slice(1, 6, 9).contiguous(),
          .detail = mean.slice(1, 9, 11).contiguous(),
          .sigma = mean.select(1, 11).sqrt(),
          .views = {}};
}

/// Robust standard deviation of the distances between the cells and all views.
double common_deviation(const SurfaceCells& cells, const std::vector<SurfaceView>& views) {
  std::vector<Tensor> distances;
  for (const SurfaceView& view : views)
    distances.push_back(observation(view, cells.points).distance);
  const Tensor all = torch::cat(distances).abs();
  return all.numel() == 0 ? 0.0 : kMad * all.median().item<double>();
}

/// What the views say about the cells [n] each.
struct Agreement {
  Tensor near, through, sum, squares;
};

Agreement agreement(const SurfaceCells& cells, const std::vector<SurfaceView>& views, double most) {
  const Tensor zero = torch::zeros_like(cells.points.select(1, 0));
  Agreement a{zero.clone(), zero.clone(), zero.clone(), zero.clone()};
  for (const SurfaceView& view : views) {
    const Observation s = observation(view, cells.points);
    const Tensor near = (s.distance.abs() <= most).to(torch::kFloat32);
    a.near.index_add_(0, s.rows, near);
    a.through.index_add_(0, s.rows, (s.distance > most).to(torch::kFloat32));
    a.sum.index_add_(0, s.rows, near * s.distance);
    a.squares.index_add_(0, s.rows, near * s.distance.square());
  }
  return a;
}

/// The cells that enough views agree on, moved to the mean of what they show.
SurfaceCells confirmed(const SurfaceCells& cells, const Agreement& a, double deviation,
                       std::int64_t enough) {
  const Tensor rows = ((a.near >= enough) & (a.near > 2.0 * a.through)).nonzero().squeeze(1);
  const auto kept = [&rows](const Tensor& t) { return t.index_select(0, rows); };
  const Tensor count = kept(a.near);
  const Tensor mean = kept(a.sum) / count;
  const Tensor spread = (kept(a.squares) - count * mean.square()).clamp_min(0.0);
  const Tensor variance = (spread + kPrior * deviation * deviation) / (count - 1.0 + kPrior);
  const Tensor normals = kept(cells.normals);
  return {.cell_m = cells.cell_m,
          .keys = kept(cells.keys),
          .points = kept(cells.points) - mean.unsqueeze(1) * normals,
          .normals = normals,
          .color = kept(cells.color),
          .detail = kept(cells.detail),
          .sigma = (variance + kept(cells.sigma).square()).sqrt(),
          .views = count.to(torch::kInt64)};
}

void annotate(SurfaceView& view, const SurfaceCells& cells) {
  const SurfacePixels seen = surface_pixels(view);
  const auto [R, t] = camera_pose(view.view, seen.points);
  const Tensor rows = rows_of(cells.keys, cell_keys((seen.points - t).mm(R), cells.cell_m));
  view.sigma = torch::zeros_like(view.planes.select(1, 0));
  const Tensor known = rows >= 0;
  if (cells.size() > 0) {
    view.sigma.index_put_({seen.pixels.index({known})},
                          cells.sigma.index_select(0, rows.index({known})));
  }
  view.planes = view.planes * (view.sigma > 0.0).unsqueeze(1);
}

}  // namespace

Tensor cell_keys(const Tensor& points, double cell_m) {
  const Tensor index = (points / cell_m).floor().to(torch::kInt64) + kMiddle;
  const Tensor bounded = index.clamp(0, 2 * kMiddle - 1);
  return bounded.select(1, 0) * key_step(1, 0, 0) + bounded.select(1, 1) * key_step(0, 1, 0) +
         bounded.select(1, 2);
}

std::int64_t key_step(std::int64_t x, std::int64_t y, std::int64_t z) {
  return x * (std::int64_t{1} << (2 * kBits)) + y * (std::int64_t{1} << kBits) + z;
}

Tensor rows_of(const Tensor& keys, const Tensor& wanted) {
  if (keys.size(0) == 0) return torch::full_like(wanted, -1);
  const Tensor at = torch::searchsorted(keys, wanted).clamp_max(keys.size(0) - 1);
  return torch::where(keys.index_select(0, at) == wanted, at, torch::full_like(at, -1));
}

Tensor averaged_over_cells(const Tensor& keys, const Tensor& values, std::int64_t reach) {
  Tensor sum = torch::zeros_like(values);
  Tensor count = torch::zeros_like(values.slice(1, 0, 1));
  for (std::int64_t x = -reach; x <= reach; ++x) {
    for (std::int64_t y = -reach; y <= reach; ++y) {
      for (std::int64_t z = -reach; z <= reach; ++z) {
        const Tensor rows = rows_of(keys, keys + key_step(x, y, z));
        const Tensor known = (rows >= 0).to(values.scalar_type()).unsqueeze(1);
        sum += known * values.index_select(0, rows.clamp_min(0));
        count += known;
      }
    }
  }
  return sum / count.clamp_min(1.0);
}

SurfaceCells surface_cells(std::vector<SurfaceView>& views, double cell_m) {
  const torch::NoGradGuard no_grad;
  const SurfaceCells cells = gathered(views, cell_m);
  const double deviation = std::max(common_deviation(cells, views), kMinDeviation * cell_m);
  const Agreement a = agreement(cells, views, kSigmas * deviation);
  const auto enough = std::min(kMinViews, static_cast<std::int64_t>(views.size()));
  SurfaceCells out = confirmed(cells, a, deviation, enough);
  for (SurfaceView& view : views) annotate(view, out);
  return out;
}

}  // namespace apvi::change
