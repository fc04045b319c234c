// SPDX-License-Identifier: BSD-3-Clause
#include "empty_places.hpp"

#include <torch/torch.h>

#include <tuple>

#include "apvi/mapping/open_water.hpp"
#include "apvi/mapping/step_constants.hpp"
#include "apvi/mapping/view_gains.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kEmpty = 0.3;        // alpha, at most
constexpr std::int64_t kAround = 9;   // [px] of a square that is empty
constexpr std::int64_t kGrid = 8;     // [px] between places
constexpr std::int64_t kMost = 2000;  // places that are compared
constexpr double kOffset = 0.01;      // of a colour, which counts as nothing
constexpr std::int64_t kFewest = 40;  // places
constexpr std::int64_t kFewestViews = 3;
constexpr double kFar_m = 1e3;
constexpr int kShifts = 3;

/// When places show one water.
struct Likeness {
  double nearly;  ///< most logarithm of a colour over the water's, of places that may show it
  double alike;   ///< the same, of such among each other
  double share;   ///< of those nearly of its colour, at least
};
constexpr Likeness kOfBare = {.nearly = 0.7, .alike = 0.08, .share = 0.5};
constexpr Likeness kOfSky = {.nearly = 0.35, .alike = 0.05, .share = 0.8};  // the map may hide it

/// Which of the rows [n,3] lie together in the densest place: [n] bool (mean shift from there).
Tensor densest(const Tensor& rows, double alike) {
  const Tensor near = torch::cdist(rows, rows) < alike;
  Tensor together = near[near.sum(1).argmax().item<std::int64_t>()];
  for (int i = 0; i < kShifts; ++i) {
    together = (rows - rows.index({together}).mean(0)).norm(2, 1) < alike;
  }
  return together;
}

/// Which of the candidates [n] bool show one water, by `ratios` [n,3] to the `water`'s colour:
/// their numbers, none when it is not most of those that may, or too few.
Tensor of_one_water(const Tensor& ratios, const Tensor& water, const Tensor& candidates,
                    const Likeness& likeness) {
  const Tensor nearly = (candidates & (ratios.abs() < likeness.nearly).all(1)).nonzero().squeeze(1);
  const auto count = nearly.size(0);
  if (count < kFewest) return {};
  const Tensor comparable = (ratios * water / (water + kOffset)).index_select(0, nearly);
  Tensor which = nearly.index({densest(comparable, likeness.alike)});
  const auto n = which.size(0);
  const bool most = static_cast<double>(n) >= likeness.share * static_cast<double>(count);
  return n >= kFewest && most ? which : Tensor();
}

}  // namespace

void EmptyPlaces::add(std::int64_t number, const splat::View& camera, const Tensor& picture,
                      const Tensor& alpha) {
  const splat::Intrinsics& k = camera.intrinsics;
  const Tensor covered =
      torch::max_pool2d(alpha.view({1, 1, k.height, k.width}), kAround, 1, kAround / 2);
  const auto [mean, even] = evenness(picture);
  const Tensor bare = covered.view({k.height, k.width}) < kEmpty;
  const Tensor sky = above(horizon(camera), k.height, k.width, picture.device());
  const Tensor empty = even & (bare | sky) & (mean.amax(0) < step::kSaturated);
  const auto thinned = [](const Tensor& t) {
    return t.slice(0, kGrid / 2, t.size(0), kGrid).slice(1, kGrid / 2, t.size(1), kGrid);
  };
  const Tensor at = thinned(empty).nonzero();
  if (at.size(0) == 0) return;
  const auto there = [&](const Tensor& t) {
    return thinned(t).index({at.select(1, 0), at.select(1, 1)}).to(torch::kCPU);
  };
  colors_.push_back(there(mean.permute({1, 2, 0})).to(torch::kFloat64));
  bare_.push_back(there(bare));
  above_.push_back(there(sky));
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
  Tensor which = of_one_water(ratios, water, joined(above_), kOfSky);
  if (!which.defined()) which = of_one_water(ratios, water, joined(bare_), kOfBare);
  if (!which.defined()) return s;
  const auto n = which.size(0);
  const auto seen_by = std::get<0>(torch::_unique(views.index_select(0, which))).size(0);
  if (seen_by < kFewestViews) return s;
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
