// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/surface_observations.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "gaussians/device.hpp"
#include "gaussians/render/render.hpp"
#include "mapping/appearance/view_gains.hpp"
#include "mapping/blur.hpp"
#include "mapping/density/seeds.hpp"
#include "mapping/surface_depth.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::nn::functional::normalize;

constexpr int kMaxWidth = 320;                // [px] of the downscaled images
constexpr double kSurfaceAlpha = 0.8;         // minimum alpha of a surface
constexpr double kMaxDepthDifference = 0.03;  // relative, between views of the same surface point
constexpr double kMargin = 4.0;               // [px] at the image border
constexpr double kPatchPx = 1.6;              // standard deviation of a patch at the far quantile
constexpr double kFarQuantile = 0.95;         // of the point depths
constexpr double kImageBlur = 0.5;            // [px] standard deviation of the camera's own blur
constexpr std::int64_t kBlurLevels = 8;       // each sqrt(2) times as wide as the last
constexpr double kMaxPatchDepthDifference = 0.03;     // relative change of a patch's mean depth
constexpr std::int64_t kNeighborOffset = 3;           // [px] for finite differences
constexpr double kMaxNeighborDepthDifference = 0.15;  // relative, at that offset
constexpr double kMinSinGrazing = 0.2;                // limits grazing views
constexpr double kNormalBlurPx = 6.0;  // standard deviation of the depth blur for smoothed normals
constexpr double kSaturatedLevel = 0.97;
constexpr std::int64_t kMinObservations = 3;  // of a point

/// Smoothed unit surface normals [p,3] in the camera frame at pixels [p,2] of a view, from the
/// slope of blurred inverse depth, which is linear in the pixels on a plane. Insensitive to the
/// roughness of an early map.
Tensor normals_from_depth(const SampledView& view, const Tensor& pixels) {
  const gaussians::Intrinsics& k = view.camera.intrinsics;
  const Tensor depth = view.depth.to(gaussians::active_device(), torch::kFloat32);
  const Tensor w = blurred_inverse_depth(depth, kNormalBlurPx).to(torch::kCPU, torch::kFloat64);
  const Tensor u = pixels.select(1, 0).floor().to(torch::kInt64);
  const Tensor v = pixels.select(1, 1).floor().to(torch::kInt64);
  const auto at = [&](std::int64_t du, std::int64_t dv) {
    const Tensor x = (u + du).clamp(0, k.width - 1);
    const Tensor y = (v + dv).clamp(0, k.height - 1);
    return w.reshape({-1}).index_select(0, y * k.width + x);
  };
  const double step = 2.0 * static_cast<double>(kNeighborOffset);
  const Tensor by_u = (at(kNeighborOffset, 0) - at(-kNeighborOffset, 0)) / step;
  const Tensor by_v = (at(0, kNeighborOffset) - at(0, -kNeighborOffset)) / step;
  const Tensor ahead =
      at(0, 0) - by_u * (pixels.select(1, 0) - k.cx) - by_v * (pixels.select(1, 1) - k.cy);
  return normalize(torch::stack({by_u * k.fx, by_v * k.fy, ahead}, 1));
}

/// Scale of an image patch on a slanted surface, so that the texture is blurred as much as in a
/// frontal view: the sum of the two variances on the surface is the same.
Tensor foreshortening(const SampledView& view, const Tensor& points, const Tensor& normals) {
  const Tensor rays = points - camera_center(view.camera.T_camera_world);
  const Tensor sine = ((rays * normals).sum(1) / rays.norm(2, 1)).abs().clamp_min(kMinSinGrazing);
  return (2.0 / (1.0 + sine.square().reciprocal())).sqrt();
}

/// Blur pyramid of an image [H,W,C]: [1,C,kBlurLevels,H,W].
Tensor blur_stack(const Tensor& image) {
  const Tensor planes = image.permute({2, 0, 1}).unsqueeze(1);
  std::vector<Tensor> levels;
  for (std::int64_t k = 0; k < kBlurLevels; ++k) {
    levels.push_back(blurred(planes, kImageBlur * std::pow(2.0, 0.5 * static_cast<double>(k))));
  }
  return torch::cat(levels, 1).unsqueeze(0);
}

/// Interpolated values [n,C] of a volume [1,C,D,H,W] at pixels [n,2] and levels [n].
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

}  // namespace

int observation_reduction(const gaussians::Intrinsics& camera) {
  return std::max(1, (camera.width + kMaxWidth - 1) / kMaxWidth);
}

SampledView sample_view(const Map& map, const KeyframeStore& keyframes, std::size_t i,
                        std::size_t cluster) {
  SampledView view;
  view.keyframe = i;
  view.cluster = cluster;
  view.camera = keyframes.view(i, observation_reduction(keyframes[i].intrinsics));
  const gaussians::RenderOutput out = gaussians::render(
      map.gaussians, view.camera, {.antialiased = map.antialiased, .background = {}});
  const Tensor depth = surface_depth(map, view.camera, out.depth, out.alpha);
  view.alpha = out.alpha;
  Tensor surface = out.alpha > kSurfaceAlpha;
  const Tensor scene =
      keyframes.scene(i, observation_reduction(keyframes[i].intrinsics), depth.device());
  if (scene.defined()) {
    surface = surface & scene;
    view.alpha = view.alpha.masked_fill(scene.logical_not(), 1.0);  // no open water either
  }
  view.depth = (depth * surface).to(torch::kCPU, torch::kFloat64);
  return view;
}

void sample_points(SampledView& view, std::int64_t count, bool with_lamp, Random& random) {
  const gaussians::Intrinsics& k = view.camera.intrinsics;
  std::array<std::vector<double>, 5> pixels;  // the point and its four neighbors
  std::array<std::vector<double>, 5> depths;
  const auto depth = view.depth.accessor<double, 2>();
  for (std::int64_t n = 0; n < count; ++n) {
    const auto u = static_cast<std::int64_t>(random.uniform() * k.width);
    const auto v = static_cast<std::int64_t>(random.uniform() * k.height);
    if (u < kNeighborOffset || v < kNeighborOffset || u + kNeighborOffset >= k.width ||
        v + kNeighborOffset >= k.height)
      continue;
    const std::array<std::pair<std::int64_t, std::int64_t>, 5> places = {
        {{u, v},
         {u - kNeighborOffset, v},
         {u + kNeighborOffset, v},
         {u, v - kNeighborOffset},
         {u, v + kNeighborOffset}}};
    const double here = depth[v][u];
    const bool smooth = std::all_of(places.begin(), places.end(), [&](const auto& p) {
      return std::abs(depth[p.second][p.first] - here) < kMaxNeighborDepthDifference * here;
    });
    for (std::size_t i = 0; smooth && i < places.size(); ++i) {
      pixels[i].push_back(static_cast<double>(places[i].first) + 0.5);
      pixels[i].push_back(static_cast<double>(places[i].second) + 0.5);
      depths[i].push_back(depth[places[i].second][places[i].first]);
    }
  }
  std::array<Tensor, 5> at;
  for (std::size_t i = 0; i < at.size(); ++i) {
    at[i] = world_points(view.camera, torch::tensor(pixels[i], torch::kFloat64).reshape({-1, 2}),
                         torch::tensor(depths[i], torch::kFloat64));
  }
  const Tensor normals = torch::linalg_cross(at[2] - at[1], at[4] - at[3]);
  view.points = at[0];
  view.normals = normalize(normals);
  view.smooth_normals = view.normals;
  if (!with_lamp) return;
  const Tensor R = view.camera.T_camera_world.slice(0, 0, 3).slice(1, 0, 3);
  view.smooth_normals =
      normals_from_depth(view, torch::tensor(pixels[0], torch::kFloat64).reshape({-1, 2})).mm(R);
}

double patch_size(const std::vector<SampledView>& views) {
  std::vector<Tensor> depths;
  for (const SampledView& view : views) depths.push_back(project(view.camera, view.points).depths);
  const Tensor all = std::get<0>(torch::cat(depths).sort());
  if (all.size(0) == 0) return 0.0;
  const auto far = static_cast<std::int64_t>(kFarQuantile * static_cast<double>(all.size(0) - 1));
  return kPatchPx * all[far].item<double>() / views.front().camera.intrinsics.fx;
}

void ObservationCollector::add(const SampledView& view, std::int64_t number, const Tensor& points,
                               const Tensor& normals, const Tensor& smooth_normals,
                               const Tensor& numbers) {
  if (points.size(0) == 0) return;
  const gaussians::Intrinsics& k = view.camera.intrinsics;
  const ProjectedPoints seen = project(view.camera, points);
  const Tensor u = seen.pixels.select(1, 0);
  const Tensor v = seen.pixels.select(1, 1);
  const Tensor inside = seen.in_view & (u > kMargin) & (v > kMargin) & (u < k.width - kMargin) &
                        (v < k.height - kMargin);
  const Tensor depth =
      sample(view.depth.view({1, 1, 1, k.height, k.width}), seen.pixels, torch::zeros_like(u))
          .squeeze(1);
  // Blur level of the patch; patches outside the range of levels are skipped.
  const Tensor blur2 =
      (patch_m_ * k.fx / seen.depths.clamp_min(1e-3) * foreshortening(view, points, normals))
          .square() -
      kImageBlur * kImageBlur;
  const Tensor levels = torch::log2(blur2.clamp_min(1e-6) / (kImageBlur * kImageBlur));
  const Tensor visible = inside & ((depth / seen.depths - 1.0).abs() < kMaxDepthDifference) &
                         (levels >= 0.0) & (levels <= static_cast<double>(kBlurLevels - 1));
  const Tensor index = visible.nonzero().squeeze(1);
  if (index.size(0) == 0) return;
  const Tensor pixels = seen.pixels.index_select(0, index);
  const Tensor z = seen.depths.index_select(0, index);
  const Tensor x = (pixels.select(1, 0) - k.cx) / k.fx;
  const Tensor y = (pixels.select(1, 1) - k.cy) / k.fy;
  const Tensor level = levels.index_select(0, index);
  const Tensor image = to_float_image(keyframes_.pixels(view.keyframe).to(device_),
                                      observation_reduction(keyframes_[view.keyframe].intrinsics),
                                      curve_.byte_table(device_));
  const Tensor stack =
      blur_stack(torch::cat({image, view.depth.to(image.options()).unsqueeze(2)}, 2));
  const Tensor patch = sample(stack, pixels, level);
  const Tensor color = patch.slice(1, 0, 3);
  const Tensor slope = curve_.slope(color);
  const Tensor around =
      sample(stack, pixels, (level + 2.0).clamp_max(kBlurLevels - 1.0)).slice(1, 0, 3);
  // Across a depth edge, the patch would mix in the color of the background.
  const Tensor on_surface = (patch.select(1, 3) / z - 1.0).abs() < kMaxPatchDepthDifference;
  const Tensor valid = ((std::get<0>(curve_.encode(color).max(1)) < kSaturatedLevel) & on_surface)
                           .nonzero()
                           .squeeze(1);
  const auto keep = [&valid](const Tensor& t) { return t.index_select(0, valid); };
  points_.push_back(keep(numbers.index_select(0, index)));
  views_.push_back(torch::full({valid.size(0)}, number, torch::kInt64));
  ranges_.push_back(keep(z * torch::sqrt(x.square() + y.square() + 1.0)));
  corners2_.push_back(keep(corners2(k, pixels.select(1, 0), pixels.select(1, 1))));
  colors_.push_back(keep(color));
  slopes_.push_back(keep(slope));
  texture_.push_back(keep(((around - color).abs() * slope).mean(1)));
  places_.push_back(keep(seen.points.index_select(0, index)));
  const Tensor R = view.camera.T_camera_world.slice(0, 0, 3).slice(1, 0, 3);
  normals_.push_back(keep(smooth_normals.index_select(0, index).mm(R.to(normals.options()).t())));
}

medium::Observations ObservationCollector::observations(std::int64_t point_count,
                                                        std::int64_t view_count) const {
  if (points_.empty()) return {};
  const Tensor points = torch::cat(points_);
  const Tensor frequent = torch::bincount(points, {}, point_count) >= kMinObservations;
  const Tensor kept = frequent.index_select(0, points).nonzero().squeeze(1);
  const Tensor renumbered = frequent.to(torch::kInt64).cumsum(0) - 1;
  const auto keep = [&kept](const std::vector<Tensor>& parts) {
    return torch::cat(parts).index_select(0, kept);
  };
  return {.points = renumbered.index_select(0, keep(points_)),
          .views = keep(views_),
          .ranges = keep(ranges_),
          .corners2 = keep(corners2_),
          .colors = keep(colors_),
          .slopes = keep(slopes_),
          .texture = keep(texture_),
          .places = keep(places_),
          .normals = keep(normals_),
          .point_count = frequent.sum().item<std::int64_t>(),
          .view_count = view_count};
}

}  // namespace apvi::mapping
