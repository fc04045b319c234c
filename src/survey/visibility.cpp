// SPDX-License-Identifier: BSD-3-Clause
#include "survey/visibility.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <limits>

#include "gaussians/model/rows.hpp"
#include "survey/crs_points.hpp"

namespace apvi::survey {
namespace {

using torch::Tensor;

constexpr std::size_t kMaxViews = 2048;
constexpr std::int64_t kMinViews = 3;
constexpr double kFar = 2.0;  // times the median distance

/// What the views seen so far say about each Gaussian; the distances are infinite before.
struct Sightlines {
  Tensor points;      ///< [N,3] float64: relative to the anchor of the map, z up [m]
  Tensor count;       ///< [N] views that have the center in their image
  Tensor distance;    ///< [N] to the nearest of them [m]
  Tensor horizontal;  ///< [N] to the nearest camera as seen from above [m]
  Tensor camera_z;    ///< [N] height of that camera
};

Sightlines start(const SurveyMap& map) {
  Sightlines s;
  s.points = crs_points(map, map.T_crs_map.translation);
  const Tensor zero = torch::zeros_like(s.points.select(1, 0));
  s.count = zero.to(torch::kInt64);
  s.distance = zero + std::numeric_limits<double>::infinity();
  s.horizontal = s.distance.clone();
  s.camera_z = zero.clone();
  return s;
}

void add_image(Sightlines& s, const Tensor& means, const gaussians::View& view) {
  const gaussians::Intrinsics& k = view.intrinsics;
  const Tensor T = view.T_camera_world.to(means.options());
  const Tensor p = means.mm(T.slice(0, 0, 3).slice(1, 0, 3).t()) + T.slice(0, 0, 3).select(1, 3);
  const Tensor z = p.select(1, 2);
  const Tensor u = k.fx * p.select(1, 0) / z + k.cx;
  const Tensor v = k.fy * p.select(1, 1) / z + k.cy;
  const Tensor inside = (z > 0.0) & (u > 0.0) & (u < k.width) & (v > 0.0) & (v < k.height);
  s.count += inside;
  s.distance = torch::where(inside, torch::minimum(s.distance, p.norm(2, 1)), s.distance);
}

void add_camera(Sightlines& s, const SurveyMap& map, const gaussians::View& view) {
  const Tensor T = view.T_camera_world.to(s.points.options());
  const Tensor R = T.slice(0, 0, 3).slice(1, 0, 3);
  const Tensor center = -crs_rotation(map).mv(R.t().mv(T.slice(0, 0, 3).select(1, 3)));
  const Tensor apart = (s.points.slice(1, 0, 2) - center.slice(0, 0, 2)).norm(2, 1);
  const Tensor nearer = apart < s.horizontal;
  s.horizontal = torch::where(nearer, apart, s.horizontal);
  s.camera_z = torch::where(nearer, center[2], s.camera_z);
}

Tensor kept_rows(const Sightlines& s, std::size_t views) {
  const Tensor seen =
      s.count >= std::min<std::int64_t>(kMinViews, static_cast<std::int64_t>(views));
  const Tensor distances = s.distance.index({seen});
  const double farthest = distances.numel() == 0 ? 0.0 : kFar * distances.median().item<double>();
  const Tensor below = s.points.select(1, 2) < s.camera_z;
  return (seen & (s.distance <= farthest) & below).nonzero().squeeze(1);
}

}  // namespace

SurveyMap seen_from_above(const SurveyMap& map, const std::vector<gaussians::View>& views) {
  if (views.empty() || map.map.gaussians.size() == 0) return map;
  const torch::NoGradGuard no_grad;
  const Tensor means = map.map.gaussians.means.to(torch::kFloat64);
  Sightlines seen = start(map);
  const std::size_t stride = (views.size() + kMaxViews - 1) / kMaxViews;
  for (std::size_t i = 0; i < views.size(); i += stride) {
    add_image(seen, means, views[i]);
    add_camera(seen, map, views[i]);
  }
  const Tensor rows = kept_rows(seen, views.size());
  SurveyMap out = map;
  out.map.gaussians = gaussians::select(map.map.gaussians, rows);
  return out;
}

}  // namespace apvi::survey
