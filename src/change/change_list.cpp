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
constexpr double kMinArea = 0.785;       // of the square of the smallest size: a disc
constexpr double kCertainRelief = 0.25;  // the same, of cells that are certain
constexpr double kCertainLook = 0.785;   // more of them, because colors are averaged over some
constexpr double kSameThing = 0.5;       // correlation of what is seen of it
constexpr double kShade = 0.2231;        // logarithm of 1.25: channels that are as bright or dark
constexpr double kReliefSigmas = 2.0;
constexpr double kSimilarSize = 1.5;   // largest ratio of moved things
constexpr double kSimilarColor = 0.3;  // largest difference of logarithms

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

/// What all kinds have in common; nothing when it is too small, or less than `certain` squares of
/// the smallest size are `strong`.
std::optional<Change> change_at(const Surface& surface, const Tensor& rows, const Tensor& strong,
                                double certain, double min_size_m) {
  Change c;
  c.points = surface.moved.index_select(0, rows);
  const double cell = surface.cells.cell_m;
  const Extent extent = extent_of(c.points, cell);
  const double square_m2 = min_size_m * min_size_m;
  const double strong_m2 = cell * cell * strong.sum().item<double>();
  const bool large = extent.length_m >= min_size_m && extent.area_m2 >= kMinArea * square_m2;
  if (!large || strong_m2 < certain * square_m2) return std::nullopt;
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

/// Whether the cells are in front of the surface of the other session.
bool stands_out(const Surface& surface, const Tensor& cells) {
  const Tensor relief = surface.votes.relief.index_select(0, cells);
  const Tensor noise = surface.votes.noise.index_select(0, cells).clamp_min(1e-6);
  return (relief / noise).median().item<double>() > kReliefSigmas;
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
    auto change =
        change_at(surface, rows, strong.index_select(0, rows), kCertainRelief, min_size_m);
    if (!change || correlation(surface.colors, rows) > kSameThing) continue;
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

std::vector<Change> look_changes(const Surface& surface, double other_black, Kind standing_out,
                                 const Tensor& rows, const ColorResiduals& colors,
                                 double min_size_m) {
  const Tensor largest = std::get<0>(colors.residual.abs().max(1));
  const Tensor far = colors.distance > kColorDistance;
  const Tensor strong = far & (largest > kColorFactor);
  const Tensor weak = far & (largest > 0.5 * kColorFactor);
  const bool later = standing_out == Kind::appeared;
  std::vector<Change> out;
  for (const auto& members : clusters(surface.cells.keys.index_select(0, rows), strong, weak)) {
    const Tensor some = as_tensor(members, rows);
    const Tensor cells = rows.index_select(0, some);
    auto change = change_at(surface, cells, strong.index_select(0, some), kCertainLook, min_size_m);
    if (!change) continue;
    const Tensor inner = some.index({strong.index_select(0, some)});
    const Tensor logarithms = std::get<0>(colors.residual.index_select(0, inner).median(0));
    const bool same_thing = correlation(surface.colors, cells) > kSameThing;
    if (same_thing && (logarithms.max() - logarithms.min()).item<double>() < kShade) continue;
    const double distance = colors.distance.index_select(0, some).mean().item<double>();
    change->confidence = std::max(0.0, 1.0 - 4.0 / (distance * distance));
    const auto own = mean_light(surface.colors.own.index_select(0, cells), surface.black);
    const auto other = mean_light(surface.colors.other.index_select(0, cells), other_black);
    change->kind = !same_thing && stands_out(surface, cells) ? standing_out : Kind::color;
    if (change->kind == Kind::color) {
      change->before = later ? other : own;
      change->after = later ? own : other;
      change->factors = array(logarithms.exp());
    } else {
      (later ? change->after : change->before) = own;
      change->relief_m = surface.votes.relief.index_select(0, cells).mean().item<double>();
    }
    out.push_back(std::move(*change));
  }
  return out;
}

void append(std::vector<Change>& changes, std::vector<Change> more) {
  std::move(more.begin(), more.end(), std::back_inserter(changes));
}

void append_color_changes(std::vector<Change>& changes, std::vector<Change> more,
                          double min_size_m) {
  const auto is_at_one = [&](const Change& change) {
    return std::any_of(changes.begin(), changes.end(), [&](const Change& other) {
      return other.kind != Kind::color && touches(change, other, min_size_m);
    });
  };
  // Those that stand out first: the others can be their rims.
  std::stable_partition(more.begin(), more.end(),
                        [](const Change& c) { return c.kind != Kind::color; });
  for (Change& change : more) {
    if (!is_at_one(change)) changes.push_back(std::move(change));
  }
}

void finish(std::vector<Change>& changes) {
  std::stable_sort(changes.begin(), changes.end(), [](const Change& a, const Change& b) {
    return a.kind != b.kind ? a.kind < b.kind : a.area_m2 > b.area_m2;
  });
  pair_moved(changes);
}

}  // namespace apvi::change
