// SPDX-License-Identifier: BSD-3-Clause
#include "empty_places.hpp"

#include <torch/torch.h>

#include <tuple>

#include "apvi/mapping/open_water.hpp"
#include "apvi/mapping/view_gains.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kEmpty = 0.3;        // alpha, at most
constexpr std::int64_t kAround = 9;   // [px] of a square that is empty
constexpr std::int64_t kGrid = 8;     // [px] between places
constexpr std::int64_t kMost = 2000;  // places that are compared
constexpr double kNearly = 0.7;       // logarithm of a colour over the water's
constexpr double kAlike = 0.08;       // the same, of places that show one water
constexpr double kOffset = 0.01;      // of a colour, which counts as nothing
constexpr std::int64_t kFewest = 40;  // places
constexpr std::int64_t kFewestViews = 3;
constexpr double kShare = 0.5;  // of those nearly of the water's colour
constexpr double kFar_m = 1e3;
constexpr int kShifts = 3;

/// Which of the rows [n,3] lie together in the densest place: [n] bool (mean shift from there).
Tensor densest(const Tensor& rows) {
  const Tensor near = torch::cdist(rows, rows) < kAlike;
  Tensor together = near[near.sum(1).argmax().item<std::int64_t>()];
  for (int i = 0; i < kShifts; ++i) {
    together = (rows - rows.index({together}).mean(0)).norm(2, 1) < kAlike;
  }
  return together;
}

}  // namespace

void EmptyPlaces::add(std::int64_t number, const splat::View& camera, const Tensor& picture,
                      const Tensor& alpha) {
  const splat::Intrinsics& k = camera.intrinsics;
  const Tensor covered =
      torch::max_pool2d(alpha.view({1, 1, k.height, k.width}), kAround, 1, kAround / 2);
  const auto [mean, even] = evenness(picture);
  const Tensor empty = even & (covered.view({k.height, k.width}) < kEmpty);
  const auto thinned = [](const Tensor& t) {
    return t.slice(0, kGrid / 2, t.size(0), kGrid).slice(1, kGrid / 2, t.size(1), kGrid);
  };
  const Tensor at = thinned(empty).nonzero();
  if (at.size(0) == 0) return;
  colors_.push_back(thinned(mean.permute({1, 2, 0}))
                        .index({at.select(1, 0), at.select(1, 1)})
                        .to(torch::kCPU, torch::kFloat64));
  const Tensor pixels =
      (kGrid * at.to(torch::kCPU) + kGrid / 2).to(torch::kFloat64) + 0.5;  // row, column
  corners2_.push_back(corners2(k, pixels.select(1, 1), pixels.select(1, 0)));
  views_.push_back(torch::full({at.size(0)}, number, torch::kInt64));
}

Sightings EmptyPlaces::open_water(const WaterFit& fit) const {
  Sightings s;
  s.view_count = fit.log_gains.size(0);
  if (views_.empty()) return s;
  const auto joined = [](const std::vector<Tensor>& parts) {
    const Tensor all = torch::cat(parts);
    return all.slice(0, 0, {}, 1 + all.size(0) / kMost).contiguous();
  };
  const Tensor views = joined(views_);
  const Tensor corners = joined(corners2_);
  const Tensor colors = joined(colors_);
  const Tensor response =
      fit.log_gains.exp().index_select(0, views) * (1.0 - fit.vignetting * corners);
  const Tensor water = fit.medium.b_inf;
  const Tensor ratios = (colors / response.unsqueeze(1) / water).clamp_min(1e-6).log();
  const Tensor nearly = (ratios.abs() < kNearly).all(1).nonzero().squeeze(1);
  if (nearly.size(0) < kFewest) return s;
  const Tensor comparable = (ratios * water / (water + kOffset)).index_select(0, nearly);
  const Tensor which = nearly.index({densest(comparable)});
  const auto n = which.size(0);
  const auto seen_by = std::get<0>(torch::_unique(views.index_select(0, which))).size(0);
  if (n < kFewest || seen_by < kFewestViews) return s;
  if (static_cast<double>(n) < kShare * static_cast<double>(nearly.size(0))) return s;
  const auto keep = [&which](const Tensor& t) { return t.index_select(0, which); };
  s.points = torch::arange(n, torch::kInt64);
  s.views = keep(views);
  s.ranges = torch::full({n}, kFar_m, torch::kFloat64);
  s.corners2 = keep(corners);
  s.colors = keep(colors);
  s.texture = torch::zeros({n}, torch::kFloat64);
  s.point_count = n;
  return s;
}

}  // namespace apvi::mapping
