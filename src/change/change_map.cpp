// SPDX-License-Identifier: BSD-3-Clause
#include "change/change_map.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "apvi/core/error.hpp"
#include "change/change_list.hpp"
#include "change/color_comparison.hpp"
#include "change/color_residuals.hpp"
#include "change/surface_cells.hpp"
#include "change/view_selection.hpp"
#include "change/votes.hpp"

namespace apvi::change {
namespace {

using torch::Tensor;

constexpr double kCellsPerSize = 4.0;
constexpr double kPixel = 0.4;       // of a cell
constexpr double kRelief = 0.25;     // of the smallest size: smaller differences are no changes
constexpr double kBlack = 0.05;      // of the median light, added before logarithms
constexpr double kViewBytes = 36.0;  // per pixel
constexpr double kMaxBytes = 1024.0 * 1024 * 1024;  // of the views of a session

/// A part of the whole progress.
Progress part_of(const Progress& progress, double from, double to) {
  return [&progress, from, to](double fraction, std::string_view what) {
    progress(from + fraction * (to - from), what);
  };
}

std::size_t most_views(const Session& session, double pixels_per_radian) {
  const gaussians::Intrinsics& k = session.views.front().intrinsics;
  const double scale = std::min(1.0, pixels_per_radian / k.fx);
  return static_cast<std::size_t>(
      std::max(3.0, kMaxBytes / (kViewBytes * scale * scale * k.width * k.height)));
}

Surface surface_of(const Session& session, double cell_m, const char* which,
                   const Progress& progress) {
  const Scale scale = session.views.empty() ? Scale{} : scale_of(session);
  if (!(scale.depth_m > 0.0)) fail_input("the {} map shows no surface in its keyframes", which);
  const double pixel_m = kPixel * cell_m;
  Surface out;
  out.black = kBlack * scale.light;
  const auto views =
      thinned_views(session, scale.depth_m, pixel_m, most_views(session, scale.depth_m / pixel_m));
  for (const gaussians::View& view : views) {
    progress(static_cast<double>(out.views.size()) / static_cast<double>(views.size()), which);
    out.views.push_back(surface_view(session.map, view, out.black));
  }
  out.cells = surface_cells(out.views, cell_m);
  if (out.cells.size() == 0) fail_input("the {} map has no surface that its views agree on", which);
  return out;
}

std::int64_t columns(const Tensor& points, double cell_m) {
  if (points.size(0) == 0) return 0;
  const Tensor flat = points * torch::tensor({1.0F, 1.0F, 0.0F}, points.options());
  return std::get<0>(torch::_unique2(cell_keys(flat, cell_m))).size(0);
}

/// Fills the fields about what was seen.
void add_coverage(ChangeMap& map, const Surface& before, const Surface& after) {
  const Tensor known_before = before.votes.decided();
  const Tensor known_after = after.votes.decided();
  map.points = torch::cat({before.cells.points, after.moved});
  const auto state = [](const Tensor& known, Seen otherwise) {
    return torch::where(known, torch::full_like(known, static_cast<int>(Seen::both), torch::kUInt8),
                        torch::full_like(known, static_cast<int>(otherwise), torch::kUInt8));
  };
  map.seen =
      torch::cat({state(known_before, Seen::only_before), state(known_after, Seen::only_after)});
  const auto of = [&](const Tensor& which) { return map.points.index({which}); };
  const double area = map.cell_m * map.cell_m;
  const Tensor both = map.seen == static_cast<int>(Seen::both);
  const auto with = [&](Seen seen) {
    return static_cast<double>(
        columns(of(both | (map.seen == static_cast<int>(seen))), map.cell_m));
  };
  const auto compared = static_cast<double>(columns(of(both), map.cell_m));
  map.compared_m2 = area * compared;
  map.only_before_m2 = area * (with(Seen::only_before) - compared);
  map.only_after_m2 = area * (with(Seen::only_after) - compared);
}

std::array<double, 3> array(const Tensor& values) {
  return {values[0].item<double>(), values[1].item<double>(), values[2].item<double>()};
}

/// The views of each session vote on the cells of the other one.
void let_vote(Surface& first, Surface& second, const Registration& registration, double least_m,
              const Progress& progress) {
  progress(0.0, "comparing");
  second.votes = vote(second.cells, second.moved, first.views, least_m);
  progress(0.5, "comparing");
  first.votes = vote(first.cells, registration.to_after(first.cells.points), second.views, least_m);
}

/// Cells of a surface that enough views of both sessions have decided about.
struct Compared {
  Tensor rows;
  ColorResiduals colors;
};
Compared compared(const Surface& surface, double cell_m, double radius_m) {
  const Tensor support =
      torch::minimum(surface.colors.views, surface.votes.through + surface.votes.near);
  const Tensor rows =
      (surface.votes.decided() & (support >= surface.votes.enough)).nonzero().squeeze(1);
  if (rows.numel() == 0) return {rows, {}};
  const auto kept = [&rows](const Tensor& t) { return t.index_select(0, rows); };
  // Of the surface's own session after those of the other one.
  return {rows, color_residuals({.keys = kept(surface.cells.keys),
                                 .points = kept(surface.moved),
                                 .before = kept(surface.colors.other),
                                 .after = kept(surface.colors.own),
                                 .support = kept(support)},
                                cell_m, radius_m)};
}

/// What looks different: on the later surface all of it, on the earlier one what has vanished.
std::vector<Change> color_changes(ChangeMap& map, const Surface& before, const Surface& after,
                                  double min_size_m) {
  std::vector<Change> out;
  const Compared later = compared(after, map.cell_m, 0.5 * min_size_m);
  if (later.rows.numel() > 0) {
    map.color_slope = array(later.colors.slope);
    map.color_offset = array(later.colors.offset);
    out = look_changes(after, before.black, Kind::appeared, later.rows, later.colors, min_size_m);
  }
  const Compared earlier = compared(before, map.cell_m, 0.5 * min_size_m);
  if (earlier.rows.numel() == 0) return out;
  for (Change& change : look_changes(before, after.black, Kind::vanished, earlier.rows,
                                     earlier.colors, min_size_m)) {
    if (change.kind == Kind::vanished) out.push_back(std::move(change));
  }
  return out;
}

}  // namespace

const char* to_string(Kind kind) {
  switch (kind) {
    case Kind::appeared:
      return "appeared";
    case Kind::vanished:
      return "vanished";
    case Kind::color:
      break;
  }
  return "color";
}

Tensor ChangeMap::as_before(const Tensor& light) const {
  if (color_slope[0] == 0.0) return light;
  const auto row = [&light](const std::array<double, 3>& a) {
    return torch::tensor({a[0], a[1], a[2]}, torch::kFloat64).to(light.options());
  };
  const Tensor logarithm = (light.clamp_min(0.0) + black[1]).log();
  return (((logarithm - row(color_offset)) / row(color_slope)).exp() - black[0]).clamp_min(0.0);
}

ChangeMap find_changes(const Session& before, const Session& after, const Options& options,
                       const Progress& progress) {
  const torch::NoGradGuard no_grad;
  ChangeMap map;
  map.cell_m = options.cell_m > 0.0 ? options.cell_m : options.min_size_m / kCellsPerSize;
  Surface first = surface_of(before, map.cell_m, "earlier", part_of(progress, 0.0, 0.25));
  Surface second = surface_of(after, map.cell_m, "later", part_of(progress, 0.25, 0.5));
  map.black = {first.black, second.black};
  map.registration =
      align(second.cells, first.views, first.cells.detail, part_of(progress, 0.5, 0.65));
  if (map.registration.cells == 0) {
    fail_input("the two maps have no surface in common: are they in the same frame?");
  }
  first.moved = first.cells.points;
  second.moved = map.registration.to_before(second.cells.points);
  let_vote(first, second, map.registration, kRelief * options.min_size_m,
           part_of(progress, 0.65, 0.7));
  const auto forth = [&map](const Eigen::Vector3d& near) {
    return map.registration.motion_at(near);
  };
  const auto back = [&forth](const Eigen::Vector3d& near) {
    return mapping::rigid_inverse(forth(near));
  };
  second.colors = compare_colors(second.cells, second.views, {before.map, first.black, forth},
                                 [&](double done) { progress(0.7 + 0.15 * done, "comparing"); });
  first.colors = compare_colors(first.cells, first.views, {after.map, second.black, back},
                                [&](double done) { progress(0.85 + 0.15 * done, "comparing"); });
  map.enough_views = {first.votes.enough, second.votes.enough};
  add_coverage(map, first, second);
  map.changes = relief_changes(second, Kind::appeared, options.min_size_m);
  append(map.changes, relief_changes(first, Kind::vanished, options.min_size_m));
  append_color_changes(map.changes, color_changes(map, first, second, options.min_size_m),
                       options.min_size_m);
  finish(map.changes);
  return map;
}

}  // namespace apvi::change
