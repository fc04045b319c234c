// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/medium_estimation.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <utility>

#include "core/random.hpp"
#include "depth/depth.hpp"
#include "gaussians/device.hpp"
#include "mapping/density/neighbors.hpp"
#include "mapping/density/open_water_candidates.hpp"
#include "mapping/density/robust_normals.hpp"
#include "mapping/density/seeds.hpp"
#include "mapping/medium/surface_observations.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::size_t kClusterSize = 11;  // consecutive keyframes that are compared with each other
constexpr std::size_t kClusterCount = 3;  // over the whole session
constexpr std::int64_t kPointCount = 3000;
constexpr double kNormalRadius = 0.2;  // of the median range: neighborhood of fused normals

/// Keyframes at least `spacing_m` apart. If there are too many, clusters of consecutive ones: the
/// newest, whose gains are not yet estimated, and random others, so that errors of individual
/// keyframes average out over estimations.
std::vector<std::vector<std::size_t>> clusters_of(const KeyframeStore& keyframes, double spacing_m,
                                                  Random& random) {
  std::vector<std::size_t> spaced;
  Tensor last;
  for (const std::size_t i : keyframes.training()) {
    const Tensor center = camera_center(keyframes[i].T_camera_world);
    if (last.defined() && (center - last).norm().item<double>() < spacing_m) continue;
    last = center;
    spaced.push_back(i);
  }
  const std::size_t max_count = kClusterSize * kClusterCount;
  if (spaced.size() <= max_count) return {spaced};
  std::array<std::size_t, kClusterCount>
      skipped{};  // keyframes before each cluster that are in none
  for (std::size_t& count : skipped) count = random.next() % (spaced.size() - max_count + 1);
  skipped.back() = spaced.size() - max_count;
  std::sort(skipped.begin(), skipped.end());
  std::vector<std::vector<std::size_t>> clusters;
  for (std::size_t k = 0; k < kClusterCount; ++k) {
    const auto first = spaced.begin() + static_cast<std::ptrdiff_t>(skipped[k] + k * kClusterSize);
    clusters.emplace_back(first, first + static_cast<std::ptrdiff_t>(kClusterSize));
  }
  return clusters;
}

/// Depth [H,W] float64 on the CPU of a keyframe by a plane sweep over its neighbors, 0 where
/// unknown. Undefined if the estimation fails.
Tensor sweep_depth(const KeyframeStore& keyframes, std::size_t i,
                   const depth::DepthOptions& options) {
  const int reduction = observation_reduction(keyframes[i].intrinsics);
  depth::DepthRequest request;
  for (const std::size_t k : neighbors(keyframes, i, options.views)) {
    request.views.push_back(
        {depth::to_gray(keyframes.image_values(k, reduction, gaussians::active_device())),
         keyframes.view(k, reduction)});
  }
  const depth::DepthEstimate estimate = depth::estimate_depth(request, options);
  if (estimate.status != depth::DepthStatus::estimated) return {};
  return estimate.dense.to(torch::kCPU, torch::kFloat64);
}

/// With a lamp, the medium is only observable with accurate surface normals, but the map's depth is
/// rounded at creases and tilted on distant texture-less surfaces. Uses swept depth where the map
/// has a surface.
void replace_with_swept_depth(std::vector<SampledView>& views, const KeyframeStore& keyframes,
                              const depth::DepthOptions& options) {
  for (SampledView& view : views) {
    const Tensor swept = sweep_depth(keyframes, view.keyframe, options);
    if (swept.defined()) view.depth = swept * (view.depth > 0.0);
  }
}

std::vector<SampledView> sample_views(const Map& map, const KeyframeStore& keyframes,
                                      double spacing_m, bool with_lamp,
                                      const depth::DepthOptions& depth, std::uint64_t seed) {
  std::vector<SampledView> views;
  Random random(seed);
  const auto clusters = clusters_of(keyframes, spacing_m, random);
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    for (const std::size_t i : clusters[c]) views.push_back(sample_view(map, keyframes, i, c));
  }
  if (with_lamp) replace_with_swept_depth(views, keyframes, depth);
  const auto each =
      kPointCount / std::max<std::int64_t>(1, static_cast<std::int64_t>(views.size()));
  for (SampledView& view : views) sample_points(view, each, with_lamp, random);
  return views;
}

/// Fuses the smoothed normals of all views in a cluster.
void fuse_normals(std::vector<SampledView>& views, double radius_m) {
  for (std::size_t begin = 0, end = 0; begin < views.size(); begin = end) {
    std::vector<Tensor> points, smooth_normals;
    for (; end < views.size() && views[end].cluster == views[begin].cluster; ++end) {
      points.push_back(views[end].points);
      smooth_normals.push_back(views[end].smooth_normals);
    }
    const auto on_device = [](const std::vector<Tensor>& parts) {
      return torch::cat(parts).to(gaussians::active_device());
    };
    Tensor shared =
        robust_normals(on_device(points), on_device(smooth_normals), radius_m).to(torch::kCPU);
    for (std::size_t i = begin; i < end; ++i) {
      const std::int64_t own = views[i].points.size(0);
      views[i].smooth_normals = shared.slice(0, 0, own);
      shared = shared.slice(0, own);
    }
  }
}

OpenWaterCandidates empty_places(const std::vector<SampledView>& views,
                                 const KeyframeStore& keyframes,
                                 const gaussians::ToneCurve& curve) {
  OpenWaterCandidates places;
  for (std::size_t j = 0; j < views.size(); ++j) {
    const std::size_t i = views[j].keyframe;
    const torch::Device device = views[j].alpha.device();
    const Tensor image =
        to_float_image(keyframes.pixels(i).to(device),
                       observation_reduction(keyframes[i].intrinsics), curve.byte_table(device));
    places.add(static_cast<std::int64_t>(j), views[j].camera, image, views[j].alpha);
  }
  return places;
}

medium::Observations merged(const medium::Observations& a, const medium::Observations& b) {
  const auto both = [](const Tensor& x, const Tensor& y) {
    return x.defined() && y.defined() ? torch::cat({x, y}) : Tensor();
  };
  return {.points = both(a.points, b.points + a.point_count),
          .views = both(a.views, b.views),
          .ranges = both(a.ranges, b.ranges),
          .corners2 = both(a.corners2, b.corners2),
          .colors = both(a.colors, b.colors),
          .slopes = both(a.slopes, b.slopes),
          .texture = both(a.texture, b.texture),
          .places = both(a.places, b.places),
          .normals = both(a.normals, b.normals),
          .point_count = a.point_count + b.point_count,
          .view_count = a.view_count};
}

/// Median range [m] of the points from their views.
double median_range(const std::vector<SampledView>& views) {
  std::vector<Tensor> ranges;
  for (const SampledView& view : views) {
    ranges.push_back((view.points - camera_center(view.camera.T_camera_world)).norm(2, 1));
  }
  const Tensor all = torch::cat(ranges);
  return all.size(0) == 0 ? 0.0 : all.median().item<double>();
}

/// Surface points of several keyframes.
struct SampledSurfaces {
  std::vector<SampledView> views;
  std::vector<std::int64_t> first;  ///< number of each view's first point, and the total count
};

SampledSurfaces sample_surfaces(const Map& map, const KeyframeStore& keyframes, double spacing_m,
                                const medium::MediumPrior& prior, std::uint64_t seed,
                                const depth::DepthOptions& depth) {
  SampledSurfaces s;
  s.views = sample_views(map, keyframes, spacing_m, !prior.lamps.empty(), depth, seed);
  s.first = {0};
  for (const SampledView& view : s.views) s.first.push_back(s.first.back() + view.points.size(0));
  if (!prior.lamps.empty() && s.views.size() > 1)
    fuse_normals(s.views, kNormalRadius * median_range(s.views));
  return s;
}

/// Adds the points of view j and of its neighbors in the cluster as view j sees them.
void observe_view(const SampledSurfaces& s, std::size_t j, ObservationCollector& collector) {
  std::vector<Tensor> points, normals, smooth_normals, numbers;
  for (std::size_t i = 0; i < s.views.size(); ++i) {
    const std::size_t apart = i > j ? i - j : j - i;
    if (s.views[i].cluster != s.views[j].cluster || apart > kClusterSize) continue;
    points.push_back(s.views[i].points);
    normals.push_back(s.views[i].normals);
    smooth_normals.push_back(s.views[i].smooth_normals);
    numbers.push_back(torch::arange(s.first[i], s.first[i + 1], torch::kInt64));
  }
  collector.add(s.views[j], static_cast<std::int64_t>(j), torch::cat(points), torch::cat(normals),
                torch::cat(smooth_normals), torch::cat(numbers));
}

medium::Observations observe(const SampledSurfaces& s, const KeyframeStore& keyframes,
                             const gaussians::ToneCurve& curve) {
  ObservationCollector collector(keyframes, curve, s.views.front().alpha.device(),
                                 patch_size(s.views));
  for (std::size_t j = 0; j < s.views.size(); ++j) observe_view(s, j, collector);
  return collector.observations(s.first.back(), static_cast<std::int64_t>(s.views.size()));
}

/// Observations with the curve that the evidence chooses. Unless it is decided, both curves are
/// compared first, without what earlier estimations of the medium found.
medium::Observations observe_with_best_curve(const SampledSurfaces& s,
                                             const KeyframeStore& keyframes,
                                             medium::MediumPrior prior,
                                             ToneCurveEvidence& evidence) {
  if (evidence.is_decided()) return observe(s, keyframes, evidence.choice());
  prior.posterior = {};
  medium::Observations linear = observe(s, keyframes, {});
  medium::Observations power = observe(s, keyframes, kViewingCurve);
  const auto linear_fit = medium::fit_medium(linear, prior);
  const auto power_fit = medium::fit_medium(power, prior);
  if (linear_fit && power_fit) evidence.add(linear_fit->deviance, power_fit->deviance);
  return evidence.choice().is_linear() ? linear : power;
}

/// Fits the medium to observations with this tone curve.
std::optional<MediumEstimation> fit(const medium::Observations& observations,
                                    const gaussians::ToneCurve& curve, const SampledSurfaces& s,
                                    const KeyframeStore& keyframes,
                                    const medium::MediumPrior& prior) {
  auto found = medium::fit_medium(observations, prior);
  if (!found) return std::nullopt;
  MediumEstimation estimation;
  estimation.observations = observations.ranges.size(0);
  for (const SampledView& view : s.views) estimation.views.push_back(view.keyframe);
  // With a lamp, low-visibility sand is indistinguishable from open water.
  if (prior.lamps.empty()) {
    estimation.saved_deviance =
        medium::deviance_without_medium(observations, prior) - found->deviance;
    const medium::Observations open =
        empty_places(s.views, keyframes, curve).open_water(*found, curve);
    estimation.sees_open_water = open.point_count > 0;
    if (estimation.sees_open_water) found = medium::fit_medium(merged(observations, open), prior);
    if (!found) return std::nullopt;
  }
  estimation.fit = std::move(*found);
  estimation.tone_curve = curve;
  return estimation;
}

}  // namespace

std::optional<MediumEstimation> estimate_medium(const Map& map, const KeyframeStore& keyframes,
                                                double spacing_m, medium::MediumPrior prior,
                                                std::uint64_t seed,
                                                const depth::DepthOptions& depth,
                                                ToneCurveEvidence evidence) {
  const torch::NoGradGuard no_grad;
  const SampledSurfaces surfaces = sample_surfaces(map, keyframes, spacing_m, prior, seed, depth);
  if (surfaces.views.size() < 2) return std::nullopt;
  const gaussians::ToneCurve earlier = evidence.choice();
  const medium::Observations observations =
      observe_with_best_curve(surfaces, keyframes, prior, evidence);
  // What was found with another curve is not valid.
  if (!(evidence.choice() == earlier)) prior.posterior = {};
  auto estimation = fit(observations, evidence.choice(), surfaces, keyframes, prior);
  if (estimation) estimation->evidence = evidence;
  return estimation;
}

}  // namespace apvi::mapping
