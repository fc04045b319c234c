// SPDX-License-Identifier: BSD-3-Clause
#include "change/change_list.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "change/clusters.hpp"

namespace apvi::change {
namespace {

using torch::Tensor;

constexpr double kColorDistance = 4.0;   // standard deviations
constexpr double kColorFactor = 0.1823;  // logarithm of 1.2
constexpr double kMinArea = 0.25;        // of the square of the smallest size
constexpr double kSimilarSize = 1.5;     // largest ratio of moved things
constexpr double kSimilarColor = 0.3;    // largest difference of logarithms

std::array<double, 3> array(const Tensor& values) {
  return {values[0].item<double>(), values[1].item<double>(), values[2].item<double>()};
}

Eigen::Vector3d vector(const Tensor& values) {
  const auto a = array(values);
  return {a[0], a[1], a[2]};
}

Tensor as_tensor(const std::vector<std::int64_t>& rows, const Tensor& like) {
  return torch::tensor(rows, torch::kInt64).to(like.device());
}

/// Mean light of logarithms [n,3].
std::array<double, 3> mean_light(const Tensor& logarithms, double black) {
  return array((logarithms.exp() - black).clamp_min(0.0).mean(0));
}

/// The view that shows most of the points near the middle of its image.
gaussians::View best_view(const std::vector<SurfaceView>& views, const Tensor& points,
                          double near_m) {
  double best = -1.0;
  gaussians::View out;
  for (const SurfaceView& view : views) {
    const Observation s = observation(view, points);
    const gaussians::Intrinsics& k = view.view.intrinsics;
    const Tensor x = (s.pixels % k.width).to(torch::kFloat32) / k.width - 0.5;
    const Tensor y = s.pixels.div(k.width, "floor").to(torch::kFloat32) / k.height - 0.5;
    const Tensor middle = 1.0 - torch::hypot(x, y);
    const double score = (middle * (s.distance.abs() < near_m)).sum().item<double>();
    if (score > best) {
      best = score;
      out = view.view;
    }
  }
  return out;
}

/// What all kinds have in common; nothing when it is too small.
std::optional<Change> change_at(const Surface& surface, const Tensor& rows, double strong,
                                double min_size_m) {
  Change c;
  c.points = surface.moved.index_select(0, rows);
  const double cell = surface.cells.cell_m;
  const Extent extent = extent_of(c.points, cell);
  if (extent.length_m < min_size_m || strong * cell * cell < kMinArea * min_size_m * min_size_m) {
    return std::nullopt;
  }
  c.length_m = extent.length_m;
  c.width_m = extent.width_m;
  c.area_m2 = extent.area_m2;
  c.center = vector(c.points.mean(0));
  c.low = vector(std::get<0>(c.points.min(0))) - Eigen::Vector3d::Constant(0.5 * cell);
  c.high = vector(std::get<0>(c.points.max(0))) + Eigen::Vector3d::Constant(0.5 * cell);
  c.view = best_view(surface.views, surface.cells.points.index_select(0, rows), 2.0 * cell);
  const Votes& v = surface.votes;
  c.views = (v.through + v.near).index_select(0, rows).median().item<double>();
  return c;
}

double count(const Tensor& mask, const Tensor& rows) {
  return mask.index_select(0, rows).sum().item<double>();
}

bool touches(const Change& a, const Change& b, double margin) {
  return ((a.center - b.low).array() > -margin).all() &&
         ((b.high - a.center).array() > -margin).all();
}

bool is_similar(const Change& a, const Change& b) {
  const double ratio = a.length_m / b.length_m;
  if (ratio > kSimilarSize || ratio * kSimilarSize < 1.0 || !a.before || !b.after) return false;
  for (std::size_t i = 0; i < 3; ++i) {
    const double difference =
        std::log(std::max(1e-6, (*a.before)[i]) / std::max(1e-6, (*b.after)[i]));
    if (std::abs(difference) > kSimilarColor) return false;
  }
  return true;
}

void pair_moved(std::vector<Change>& changes) {
  std::vector<bool> used(changes.size(), false);
  for (Change& to : changes) {
    if (to.kind != Kind::appeared) continue;
    for (std::size_t i = 0; i < changes.size(); ++i) {
      if (changes[i].kind != Kind::vanished || used[i] || !is_similar(changes[i], to)) continue;
      to.moved_from = i;
      used[i] = true;
      break;
    }
  }
}

}  // namespace

std::vector<Change> relief_changes(const Surface& surface, Kind kind, double min_size_m) {
  const Tensor strong = surface.votes.changed();
  const Tensor weak = surface.votes.nearly_changed();
  std::vector<Change> out;
  for (const auto& members : clusters(surface.cells.keys, strong, weak)) {
    const Tensor rows = as_tensor(members, surface.moved);
    auto change = change_at(surface, rows, count(strong, rows), min_size_m);
    if (!change) continue;
    const Tensor inner = rows.index({strong.index_select(0, rows)});
    const Votes& v = surface.votes;
    const Tensor through = v.through.index_select(0, inner);
    change->kind = kind;
    change->confidence =
        (through / (through + v.near.index_select(0, inner))).mean().item<double>();
    change->relief_m = v.distance.index_select(0, inner).mean().item<double>();
    const auto light = mean_light(surface.cells.color.index_select(0, rows), surface.black);
    (kind == Kind::appeared ? change->after : change->before) = light;
    out.push_back(std::move(*change));
  }
  return out;
}

std::vector<Change> color_changes(const Surface& before, const Surface& after, const Tensor& rows,
                                  const ColorResiduals& colors, double min_size_m) {
  const Tensor large = std::get<0>(colors.residual.abs().max(1)) > kColorFactor;
  const Tensor strong = (colors.distance > kColorDistance) & large;
  const Tensor weak = (colors.distance > kColorDistance) &
                      (std::get<0>(colors.residual.abs().max(1)) > 0.5 * kColorFactor);
  std::vector<Change> out;
  for (const auto& members : clusters(after.cells.keys.index_select(0, rows), strong, weak)) {
    const Tensor some = as_tensor(members, rows);
    const Tensor cells = rows.index_select(0, some);
    auto change = change_at(after, cells, count(strong, some), min_size_m);
    if (!change) continue;
    change->kind = Kind::color;
    const double far = colors.distance.index_select(0, some).mean().item<double>();
    change->confidence = std::max(0.0, 1.0 - 4.0 / (far * far));
    change->before = mean_light(after.votes.color.index_select(0, cells), before.black);
    change->after = mean_light(after.cells.color.index_select(0, cells), after.black);
    const Tensor inner = some.index({strong.index_select(0, some)});
    const Tensor residual = colors.residual.index_select(0, inner);
    change->factors = array(std::get<0>(residual.median(0)).exp());
    out.push_back(std::move(*change));
  }
  return out;
}

void append(std::vector<Change>& changes, std::vector<Change> more) {
  std::move(more.begin(), more.end(), std::back_inserter(changes));
}

void finish(std::vector<Change>& changes, double min_size_m) {
  const std::vector<Change> all = changes;
  const auto at_rim = [&](const Change& c) {
    return c.kind == Kind::color && std::any_of(all.begin(), all.end(), [&](const Change& other) {
             return other.kind != Kind::color && touches(c, other, min_size_m);
           });
  };
  changes.erase(std::remove_if(changes.begin(), changes.end(), at_rim), changes.end());
  std::stable_sort(changes.begin(), changes.end(), [](const Change& a, const Change& b) {
    return a.kind != b.kind ? a.kind < b.kind : a.area_m2 > b.area_m2;
  });
  pair_moved(changes);
}

}  // namespace apvi::change
