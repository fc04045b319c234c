// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/water_survey.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "apvi/core/random.hpp"
#include "apvi/mapping/depth.hpp"
#include "apvi/mapping/facing.hpp"
#include "apvi/mapping/seeds.hpp"
#include "apvi/mapping/surface_depth.hpp"
#include "apvi/mapping/view_gains.hpp"
#include "apvi/splat/device.hpp"
#include "apvi/splat/render.hpp"
#include "blur.hpp"
#include "empty_places.hpp"
#include "neighbours.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::nn::functional::normalize;

constexpr std::size_t kCluster = 11;  // keyframes in a row that are compared with each other
constexpr std::size_t kClusters = 3;  // spread over the whole run
constexpr int kMostWidth = 320;       // [px] pictures are reduced to
constexpr std::int64_t kPoints = 3000;
constexpr double kSolid = 0.8;        // alpha of a surface
constexpr double kSameDepth = 0.03;   // of a surface that two views see, relative
constexpr double kMargin = 4.0;       // [px] at the edges of a picture
constexpr double kPatchPx = 1.6;      // sigma of a patch seen from far
constexpr double kFarShare = 0.95;    // of the points are nearer than "far"
constexpr double kOwnBlur = 0.5;      // [px] of a camera's picture
constexpr std::int64_t kBlurs = 8;    // pictures more and more blurred, by a factor of sqrt(2)
constexpr double kOneSurface = 0.03;  // relative change of a patch's mean depth on one surface
constexpr std::int64_t kBeside = 3;   // [px] from a point, where its surface is looked at too
constexpr double kSmooth = 0.15;      // relative change of depth there on a surface
constexpr double kFlattest = 0.2;     // sine of the angle at which a surface is still looked at
constexpr double kBroadPx = 6.0;      // sigma of "around" when asking how a surface faces
constexpr double kAround = 0.2;       // of the distance: normals so near each other are alike
constexpr double kSaturated = 0.97;
constexpr std::int64_t kLeastSightings = 3;  // of a point

/// A keyframe as it is looked at.
struct Look {
  std::size_t keyframe = 0;
  std::size_t cluster = 0;
  splat::View camera;
  Tensor alpha;    ///< [H,W]
  Tensor depth;    ///< [H,W] float64 on the CPU, 0 where nothing is
  Tensor points;   ///< [p,3] float64 of the world
  Tensor normals;  ///< [p,3] of the surface there
  Tensor facing;   ///< [p,3] the same, for a lamp: of more of the surface around
};

/// Keyframes at least `spacing_m` apart; of many, some stretches: the newest, whose gains nobody
/// has looked at, and others each time, so that what one of them says wrongly is not said again by
/// every survey.
std::vector<std::vector<std::size_t>> clusters_of(const KeyframeStore& keyframes, double spacing_m,
                                                  Random& random) {
  std::vector<std::size_t> apart;
  Tensor last;
  for (const std::size_t i : keyframes.training()) {
    const Tensor center = camera_center(keyframes[i].T_camera_world);
    if (last.defined() && (center - last).norm().item<double>() < spacing_m) continue;
    last = center;
    apart.push_back(i);
  }
  const std::size_t most = kCluster * kClusters;
  if (apart.size() <= most) return {apart};
  std::array<std::size_t, kClusters> passed{};  // before each of them, by none
  for (std::size_t& count : passed) count = random.next() % (apart.size() - most + 1);
  passed.back() = apart.size() - most;
  std::sort(passed.begin(), passed.end());
  std::vector<std::vector<std::size_t>> clusters;
  for (std::size_t k = 0; k < kClusters; ++k) {
    const auto first = apart.begin() + static_cast<std::ptrdiff_t>(passed[k] + k * kCluster);
    clusters.emplace_back(first, first + static_cast<std::ptrdiff_t>(kCluster));
  }
  return clusters;
}

int reduction_of(const splat::Intrinsics& camera) {
  return std::max(1, (camera.width + kMostWidth - 1) / kMostWidth);
}

/// Depth [H,W] float64 on the CPU of a keyframe out of its neighbours' pictures, 0 where nothing is
/// known. Undefined where they do not tell.
Tensor swept_depth(const KeyframeStore& keyframes, std::size_t i, const DepthOptions& options) {
  const int reduction = reduction_of(keyframes[i].intrinsics);
  DepthRequest request;
  for (const std::size_t k : neighbours(keyframes, i, options.views)) {
    request.views.push_back({to_grey(keyframes.image(k, reduction, splat::active_device())),
                             keyframes.view(k, reduction)});
  }
  const DepthEstimate estimate = estimate_depth(request, options);
  if (estimate.verdict != DepthVerdict::estimated) return {};
  return estimate.dense.to(torch::kCPU, torch::kFloat64);
}

Look look(const Map& map, const KeyframeStore& keyframes, std::size_t i, std::size_t cluster) {
  Look look;
  look.keyframe = i;
  look.cluster = cluster;
  look.camera = keyframes.view(i, reduction_of(keyframes[i].intrinsics));
  const splat::RenderOutput out =
      splat::render(map.gaussians, look.camera, {.antialiased = map.antialiased, .background = {}});
  const Tensor depth = surface_depth(map, look.camera, out.depth, out.alpha);
  look.alpha = out.alpha;
  look.depth = (depth * (out.alpha > kSolid)).to(torch::kCPU, torch::kFloat64);
  return look;
}

/// Which way surfaces face as a whole, at pixels [p,2] of a look: unit normals [p,3] in the
/// camera's frame. A plane's inverse depth is linear in the pixels, so its slope over many pixels
/// tells, which the roughness of a young map does not touch.
Tensor broad_normals(const Look& look, const Tensor& pixels) {
  const splat::Intrinsics& k = look.camera.intrinsics;
  const Tensor depth = look.depth.to(splat::active_device(), torch::kFloat32);
  const Tensor w = blurred_inverse_depth(depth, kBroadPx).to(torch::kCPU, torch::kFloat64);
  const Tensor u = pixels.select(1, 0).floor().to(torch::kInt64);
  const Tensor v = pixels.select(1, 1).floor().to(torch::kInt64);
  const auto at = [&](std::int64_t du, std::int64_t dv) {
    const Tensor x = (u + du).clamp(0, k.width - 1);
    const Tensor y = (v + dv).clamp(0, k.height - 1);
    return w.reshape({-1}).index_select(0, y * k.width + x);
  };
  const double step = 2.0 * static_cast<double>(kBeside);
  const Tensor by_u = (at(kBeside, 0) - at(-kBeside, 0)) / step;
  const Tensor by_v = (at(0, kBeside) - at(0, -kBeside)) / step;
  const Tensor ahead =
      at(0, 0) - by_u * (pixels.select(1, 0) - k.cx) - by_v * (pixels.select(1, 1) - k.cy);
  return normalize(torch::stack({by_u * k.fx, by_v * k.fy, ahead}, 1));
}

/// A lamp's light tells of the water only with how surfaces face it, and a map rounds off where two
/// meet and tilts what is far and even: depth is that of the pictures where the map has a surface.
void sweep(std::vector<Look>& looks, const KeyframeStore& keyframes, const DepthOptions& options) {
  for (Look& view : looks) {
    const Tensor swept = swept_depth(keyframes, view.keyframe, options);
    if (swept.defined()) view.depth = swept * (view.depth > 0.0);
  }
}

/// Random points of the surfaces that the view shows, and how these lie.
void draw_points(Look& look, std::int64_t count, bool by_lamplight, Random& random) {
  const splat::Intrinsics& k = look.camera.intrinsics;
  std::array<std::vector<double>, 5> pixels;  // of the point and beside it
  std::array<std::vector<double>, 5> depths;
  const auto depth = look.depth.accessor<double, 2>();
  for (std::int64_t n = 0; n < count; ++n) {
    const auto u = static_cast<std::int64_t>(random.uniform() * k.width);
    const auto v = static_cast<std::int64_t>(random.uniform() * k.height);
    if (u < kBeside || v < kBeside || u + kBeside >= k.width || v + kBeside >= k.height) continue;
    const std::array<std::pair<std::int64_t, std::int64_t>, 5> places = {
        {{u, v}, {u - kBeside, v}, {u + kBeside, v}, {u, v - kBeside}, {u, v + kBeside}}};
    const double here = depth[v][u];
    const bool smooth = std::all_of(places.begin(), places.end(), [&](const auto& p) {
      return std::abs(depth[p.second][p.first] - here) < kSmooth * here;
    });
    for (std::size_t i = 0; smooth && i < places.size(); ++i) {
      pixels[i].push_back(static_cast<double>(places[i].first) + 0.5);
      pixels[i].push_back(static_cast<double>(places[i].second) + 0.5);
      depths[i].push_back(depth[places[i].second][places[i].first]);
    }
  }
  std::array<Tensor, 5> at;
  for (std::size_t i = 0; i < at.size(); ++i) {
    at[i] = world_points(look.camera, torch::tensor(pixels[i], torch::kFloat64).reshape({-1, 2}),
                         torch::tensor(depths[i], torch::kFloat64));
  }
  const Tensor normals = torch::linalg_cross(at[2] - at[1], at[4] - at[3]);
  look.points = at[0];
  look.normals = normalize(normals);
  look.facing = look.normals;
  if (!by_lamplight) return;
  const Tensor R = look.camera.T_camera_world.slice(0, 0, 3).slice(1, 0, 3);
  look.facing =
      broad_normals(look, torch::tensor(pixels[0], torch::kFloat64).reshape({-1, 2})).mm(R);
}

/// How much narrower in a picture a patch must be that lies askew, so that texture is blurred as
/// much as where it is seen from above: the sum of its two variances on the surface is the same.
Tensor foreshortened(const Look& view, const Tensor& points, const Tensor& normals) {
  const Tensor rays = points - camera_center(view.camera.T_camera_world);
  const Tensor sine = ((rays * normals).sum(1) / rays.norm(2, 1)).abs().clamp_min(kFlattest);
  return (2.0 / (1.0 + sine.square().reciprocal())).sqrt();
}

/// A picture [H,W,C] ever more blurred [1,C,kBlurs,H,W].
Tensor blur_stack(const Tensor& picture) {
  const Tensor planes = picture.permute({2, 0, 1}).unsqueeze(1);
  std::vector<Tensor> levels;
  for (std::int64_t k = 0; k < kBlurs; ++k) {
    levels.push_back(blurred(planes, kOwnBlur * std::pow(2.0, 0.5 * static_cast<double>(k))));
  }
  return torch::cat(levels, 1).unsqueeze(0);
}

/// Values [n,C] of a volume [1,C,D,H,W] at pixels [n,2] and levels [n].
Tensor sample(const Tensor& volume, const Tensor& pixels, const Tensor& levels) {
  const auto normed = [](const Tensor& x, std::int64_t size) {
    return 2.0 * x / static_cast<double>(size) - 1.0;
  };
  const Tensor grid = torch::stack(
      {normed(pixels.select(1, 0), volume.size(4)), normed(pixels.select(1, 1), volume.size(3)),
       normed(levels + 0.5, volume.size(2))},
      1);
  constexpr std::int64_t kLinear = 0;
  constexpr std::int64_t kBorder = 1;
  return torch::grid_sampler(volume, grid.to(volume.options()).view({1, 1, 1, -1, 3}), kLinear,
                             kBorder, /*align_corners=*/false)
      .view({volume.size(1), -1})
      .t()
      .to(torch::kCPU, torch::kFloat64);
}

/// Collects what views see of points.
class Collector {
 public:
  Collector(const KeyframeStore& keyframes, const torch::Device& device, double patch_m)
      : keyframes_(keyframes), device_(device), patch_m_(patch_m) {}

  /// `numbers` [p] int64 of the points [p,3], with the surface's normals there.
  void add(const Look& view, std::int64_t number, const Tensor& points, const Tensor& normals,
           const Tensor& facing, const Tensor& numbers) {
    if (points.size(0) == 0) return;
    const splat::Intrinsics& k = view.camera.intrinsics;
    const SeenPoints seen = project(view.camera, points);
    const Tensor u = seen.pixels.select(1, 0);
    const Tensor v = seen.pixels.select(1, 1);
    const Tensor inside = seen.in_view & (u > kMargin) & (v > kMargin) & (u < k.width - kMargin) &
                          (v < k.height - kMargin);
    const Tensor depth =
        sample(view.depth.view({1, 1, 1, k.height, k.width}), seen.pixels, torch::zeros_like(u))
            .squeeze(1);
    // In pictures of one blur after the other; a patch that none of them holds is left out.
    const Tensor blur2 =
        (patch_m_ * k.fx / seen.depths.clamp_min(1e-3) * foreshortened(view, points, normals))
            .square() -
        kOwnBlur * kOwnBlur;
    const Tensor levels = torch::log2(blur2.clamp_min(1e-6) / (kOwnBlur * kOwnBlur));
    const Tensor visible = inside & ((depth / seen.depths - 1.0).abs() < kSameDepth) &
                           (levels >= 0.0) & (levels <= static_cast<double>(kBlurs - 1));
    const Tensor index = visible.nonzero().squeeze(1);
    if (index.size(0) == 0) return;
    const Tensor pixels = seen.pixels.index_select(0, index);
    const Tensor z = seen.depths.index_select(0, index);
    const Tensor x = (pixels.select(1, 0) - k.cx) / k.fx;
    const Tensor y = (pixels.select(1, 1) - k.cy) / k.fy;
    const Tensor level = levels.index_select(0, index);
    const Tensor picture = keyframes_.image(
        view.keyframe, reduction_of(keyframes_[view.keyframe].intrinsics), device_);
    const Tensor stack =
        blur_stack(torch::cat({picture, view.depth.to(picture.options()).unsqueeze(2)}, 2));
    const Tensor patch = sample(stack, pixels, level);
    const Tensor color = patch.slice(1, 0, 3);
    const Tensor around =
        sample(stack, pixels, (level + 2.0).clamp_max(kBlurs - 1.0)).slice(1, 0, 3);
    // What lies behind an edge, water perhaps, would be taken for the surface's own colour.
    const Tensor whole = (patch.select(1, 3) / z - 1.0).abs() < kOneSurface;
    const Tensor good = ((std::get<0>(color.max(1)) < kSaturated) & whole).nonzero().squeeze(1);
    const auto keep = [&good](const Tensor& t) { return t.index_select(0, good); };
    points_.push_back(keep(numbers.index_select(0, index)));
    views_.push_back(torch::full({good.size(0)}, number, torch::kInt64));
    ranges_.push_back(keep(z * torch::sqrt(x.square() + y.square() + 1.0)));
    corners2_.push_back(keep(corners2(k, pixels.select(1, 0), pixels.select(1, 1))));
    colors_.push_back(keep(color));
    texture_.push_back(keep((around - color).abs().mean(1)));
    places_.push_back(keep(seen.points.index_select(0, index)));
    const Tensor R = view.camera.T_camera_world.slice(0, 0, 3).slice(1, 0, 3);
    normals_.push_back(keep(facing.index_select(0, index).mm(R.to(normals.options()).t())));
  }

  /// Those of points that are seen often enough, numbered anew.
  Sightings sightings(std::int64_t point_count, std::int64_t view_count) const {
    if (points_.empty()) return {};
    const Tensor points = torch::cat(points_);
    const Tensor often = torch::bincount(points, {}, point_count) >= kLeastSightings;
    const Tensor kept = often.index_select(0, points).nonzero().squeeze(1);
    const Tensor renumbered = often.to(torch::kInt64).cumsum(0) - 1;
    const auto keep = [&kept](const std::vector<Tensor>& parts) {
      return torch::cat(parts).index_select(0, kept);
    };
    return {.points = renumbered.index_select(0, keep(points_)),
            .views = keep(views_),
            .ranges = keep(ranges_),
            .corners2 = keep(corners2_),
            .colors = keep(colors_),
            .texture = keep(texture_),
            .places = keep(places_),
            .normals = keep(normals_),
            .point_count = often.sum().item<std::int64_t>(),
            .view_count = view_count};
  }

 private:
  const KeyframeStore& keyframes_;
  torch::Device device_;
  double patch_m_;
  std::vector<Tensor> points_, views_, ranges_, corners2_, colors_, texture_, places_, normals_;
};

std::vector<Look> look_around(const Map& map, const KeyframeStore& keyframes, double spacing_m,
                              bool by_lamplight, const DepthOptions& depth, std::uint64_t seed) {
  std::vector<Look> looks;
  Random random(seed);
  const auto clusters = clusters_of(keyframes, spacing_m, random);
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    for (const std::size_t i : clusters[c]) looks.push_back(look(map, keyframes, i, c));
  }
  if (by_lamplight) sweep(looks, keyframes, depth);
  const auto each = kPoints / std::max<std::int64_t>(1, static_cast<std::int64_t>(looks.size()));
  for (Look& view : looks) draw_points(view, each, by_lamplight, random);
  return looks;
}

/// How the surface around each point faces, out of what all views of its cluster say.
void share_facing(std::vector<Look>& looks, double radius_m) {
  for (std::size_t begin = 0, end = 0; begin < looks.size(); begin = end) {
    std::vector<Tensor> points, facing;
    for (; end < looks.size() && looks[end].cluster == looks[begin].cluster; ++end) {
      points.push_back(looks[end].points);
      facing.push_back(looks[end].facing);
    }
    const auto there = [](const std::vector<Tensor>& parts) {
      return torch::cat(parts).to(splat::active_device());
    };
    Tensor shared = prevailing_normals(there(points), there(facing), radius_m).to(torch::kCPU);
    for (std::size_t i = begin; i < end; ++i) {
      const std::int64_t own = looks[i].points.size(0);
      looks[i].facing = shared.slice(0, 0, own);
      shared = shared.slice(0, own);
    }
  }
}

EmptyPlaces empty_places(const std::vector<Look>& looks, const KeyframeStore& keyframes) {
  EmptyPlaces places;
  for (std::size_t j = 0; j < looks.size(); ++j) {
    const std::size_t i = looks[j].keyframe;
    const Tensor picture =
        keyframes.image(i, reduction_of(keyframes[i].intrinsics), looks[j].alpha.device());
    places.add(static_cast<std::int64_t>(j), looks[j].camera, picture, looks[j].alpha);
  }
  return places;
}

Sightings together(const Sightings& a, const Sightings& b) {
  const auto both = [](const Tensor& x, const Tensor& y) {
    return x.defined() && y.defined() ? torch::cat({x, y}) : Tensor();
  };
  return {.points = both(a.points, b.points + a.point_count),
          .views = both(a.views, b.views),
          .ranges = both(a.ranges, b.ranges),
          .corners2 = both(a.corners2, b.corners2),
          .colors = both(a.colors, b.colors),
          .texture = both(a.texture, b.texture),
          .places = both(a.places, b.places),
          .normals = both(a.normals, b.normals),
          .point_count = a.point_count + b.point_count,
          .view_count = a.view_count};
}

/// Median distance [m] of the points from where they were seen.
double typical_range(const std::vector<Look>& looks) {
  std::vector<Tensor> ranges;
  for (const Look& view : looks) {
    ranges.push_back((view.points - camera_center(view.camera.T_camera_world)).norm(2, 1));
  }
  const Tensor all = torch::cat(ranges);
  return all.size(0) == 0 ? 0.0 : all.median().item<double>();
}

/// Sigma of a patch [m] that is kPatchPx wide from far.
double patch_size(const std::vector<Look>& looks) {
  std::vector<Tensor> depths;
  for (const Look& view : looks) depths.push_back(project(view.camera, view.points).depths);
  const Tensor all = std::get<0>(torch::cat(depths).sort());
  if (all.size(0) == 0) return 0.0;
  const auto far = static_cast<std::int64_t>(kFarShare * static_cast<double>(all.size(0) - 1));
  return kPatchPx * all[far].item<double>() / looks.front().camera.intrinsics.fx;
}

}  // namespace

std::optional<WaterSurvey> survey_water(const Map& map, const KeyframeStore& keyframes,
                                        double spacing_m, const WaterPrior& prior,
                                        std::uint64_t seed, const DepthOptions& depth) {
  const torch::NoGradGuard no_grad;
  std::vector<Look> looks =
      look_around(map, keyframes, spacing_m, prior.lamp.has_value(), depth, seed);
  if (looks.size() < 2) return std::nullopt;
  Collector collector(keyframes, map.gaussians.means.device(), patch_size(looks));
  std::vector<std::int64_t> first = {0};
  for (const Look& view : looks) first.push_back(first.back() + view.points.size(0));
  WaterSurvey survey;
  if (prior.lamp) share_facing(looks, kAround * typical_range(looks));
  for (std::size_t j = 0; j < looks.size(); ++j) {
    std::vector<Tensor> near_points;
    std::vector<Tensor> normals;
    std::vector<Tensor> facing;
    std::vector<Tensor> numbers;
    for (std::size_t i = 0; i < looks.size(); ++i) {
      const std::size_t apart = i > j ? i - j : j - i;
      if (looks[i].cluster != looks[j].cluster || apart > kCluster) continue;
      near_points.push_back(looks[i].points);
      normals.push_back(looks[i].normals);
      facing.push_back(looks[i].facing);
      numbers.push_back(torch::arange(first[i], first[i + 1], torch::kInt64));
    }
    collector.add(looks[j], static_cast<std::int64_t>(j), torch::cat(near_points),
                  torch::cat(normals), torch::cat(facing), torch::cat(numbers));
    survey.views.push_back(looks[j].keyframe);
  }
  const Sightings surfaces =
      collector.sightings(first.back(), static_cast<std::int64_t>(looks.size()));
  auto fit = fit_water(surfaces, prior);
  if (!fit) return std::nullopt;
  // By lamplight, sand in the murk looks like it.
  if (!prior.lamp) {
    const Sightings open = empty_places(looks, keyframes).open_water(*fit);
    survey.sees_open_water = open.point_count > 0;
    if (survey.sees_open_water) fit = fit_water(together(surfaces, open), prior);
    if (!fit) return std::nullopt;
  }
  survey.fit = std::move(*fit);
  return survey;
}

}  // namespace apvi::mapping
