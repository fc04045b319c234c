// SPDX-License-Identifier: BSD-3-Clause
#include "survey/survey_view.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <utility>

#include "apvi/core/constants.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::survey {
namespace {

using torch::Tensor;

constexpr std::size_t kMaxCandidates = 200;  // the nearest cameras
constexpr double kBestParallax = 10.0 * kRadiansPerDegree;
// Standard deviations of the weight below and above it.
constexpr double kNarrow = 4.0 * kRadiansPerDegree;
constexpr double kWide = 12.0 * kRadiansPerDegree;
constexpr double kMinScore = 0.02;

struct Camera {
  Tensor R;       ///< [3,3] of T_camera_world
  Tensor t;       ///< [3]
  Tensor center;  ///< [3]

  explicit Camera(const gaussians::View& view)
      : R(view.T_camera_world.slice(0, 0, 3).slice(1, 0, 3)),
        t(view.T_camera_world.slice(0, 0, 3).select(1, 3)),
        center(-R.t().mv(t)) {}
};

/// Mean weight of the points [n,3] in a view, from where they are seen along `rays` [n,3].
double score(const gaussians::View& view, const Tensor& points, const Tensor& rays) {
  const Camera camera(view);
  const gaussians::Intrinsics& k = view.intrinsics;
  const Tensor p = points.mm(camera.R.t()) + camera.t;
  const Tensor z = p.select(1, 2);
  const Tensor u = k.fx * p.select(1, 0) / z + k.cx;
  const Tensor v = k.fy * p.select(1, 1) / z + k.cy;
  const Tensor inside = (z > 0.0) & (u > 0.0) & (u < k.width) & (v > 0.0) & (v < k.height);
  const Tensor seen = points - camera.center;
  const Tensor cosine = (seen * rays).sum(1) / (seen.norm(2, 1) * rays.norm(2, 1));
  const Tensor off = cosine.clamp(-1.0, 1.0).acos() - kBestParallax;
  const Tensor sigma =
      torch::where(off < 0.0, torch::full_like(off, kNarrow), torch::full_like(off, kWide));
  const Tensor weight = (-0.5 * (off / sigma).square()).exp() * inside;
  return weight.mean().item<double>();
}

/// Indices of the other views, nearest first.
std::vector<std::size_t> nearest_views(const std::vector<gaussians::View>& views,
                                       std::size_t reference) {
  std::vector<std::pair<double, std::size_t>> by_distance;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (i == reference) continue;
    by_distance.emplace_back(
        mapping::camera_distance(views[i].T_camera_world, views[reference].T_camera_world), i);
  }
  std::sort(by_distance.begin(), by_distance.end());
  by_distance.resize(std::min(by_distance.size(), kMaxCandidates));
  std::vector<std::size_t> indices;
  for (const auto& [distance, index] : by_distance) indices.push_back(index);
  return indices;
}

}  // namespace

std::vector<gaussians::View> cameras_of(const std::vector<SurveyView>& views) {
  std::vector<gaussians::View> cameras;
  for (const SurveyView& view : views) cameras.push_back(view.camera);
  return cameras;
}

std::vector<std::size_t> comparison_views(const std::vector<gaussians::View>& views,
                                          std::size_t reference, const Tensor& points,
                                          std::size_t count) {
  if (points.size(0) == 0) return {};
  const Tensor p = points.to(torch::kCPU, torch::kFloat64);
  const Tensor rays = p - Camera(views[reference]).center;
  std::vector<std::pair<double, std::size_t>> scored;
  for (const std::size_t i : nearest_views(views, reference)) {
    const double value = score(views[i], p, rays);
    if (value > kMinScore) scored.emplace_back(-value, i);
  }
  std::sort(scored.begin(), scored.end());
  std::vector<std::size_t> best;
  for (const auto& [value, index] : scored) {
    if (best.size() < count) best.push_back(index);
  }
  return best;
}

}  // namespace apvi::survey
