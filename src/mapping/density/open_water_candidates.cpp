// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/open_water_candidates.hpp"

#include <torch/torch.h>

#include <tuple>

#include "mapping/appearance/view_gains.hpp"
#include "mapping/medium/open_water.hpp"
#include "mapping/training/step_constants.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kMaxEmptyAlpha = 0.3;         // of an empty pixel
constexpr std::int64_t kEmptyWindow_px = 9;    // that must be empty
constexpr std::int64_t kGridStep_px = 8;       // between candidates
constexpr std::int64_t kMaxCandidates = 2000;  // used for clustering
constexpr double kColorOffset = 0.01;          // regularizes ratios of dark colors
constexpr std::int64_t kMinCandidates = 40;
constexpr std::int64_t kMinViews = 3;
constexpr double kFarRange_m = 1e3;
constexpr int kMeanShiftIterations = 3;

/// When candidates show uniform open water.
struct UniformityThresholds {
  double max_water_log_ratio;    ///< maximum log ratio to the water's color
  double max_cluster_log_ratio;  ///< maximum log ratio among each other
  double min_fraction;           ///< minimum fraction of the former
};
constexpr UniformityThresholds kEmptyThresholds = {
    .max_water_log_ratio = 0.7, .max_cluster_log_ratio = 0.08, .min_fraction = 0.5};
constexpr UniformityThresholds kSkyThresholds = {.max_water_log_ratio = 0.35,
                                                 .max_cluster_log_ratio = 0.05,
                                                 .min_fraction = 0.8};  // the map may cover it

/// Members of the densest cluster of the rows [n,3], by mean shift: [n] bool.
Tensor densest_cluster(const Tensor& rows, double radius) {
  const Tensor near = torch::cdist(rows, rows) < radius;
  Tensor members = near[near.sum(1).argmax().item<std::int64_t>()];
  for (int i = 0; i < kMeanShiftIterations; ++i) {
    members = (rows - rows.index({members}).mean(0)).norm(2, 1) < radius;
  }
  return members;
}

/// Indices of the candidates [n] bool that show uniform water, by `ratios` [n,3] to the color
/// `water`; undefined when they are too few or no majority.
Tensor uniform_water(const Tensor& ratios, const Tensor& water, const Tensor& candidates,
                     const UniformityThresholds& thresholds) {
  const Tensor similar =
      (candidates & (ratios.abs() < thresholds.max_water_log_ratio).all(1)).nonzero().squeeze(1);
  const auto count = similar.size(0);
  if (count < kMinCandidates) return {};
  const Tensor comparable = (ratios * water / (water + kColorOffset)).index_select(0, similar);
  Tensor which = similar.index({densest_cluster(comparable, thresholds.max_cluster_log_ratio)});
  const auto n = which.size(0);
  const bool is_majority =
      static_cast<double>(n) >= thresholds.min_fraction * static_cast<double>(count);
  return n >= kMinCandidates && is_majority ? which : Tensor();
}

}  // namespace

void OpenWaterCandidates::add(std::int64_t number, const gaussians::View& camera,
                              const Tensor& image, const Tensor& alpha) {
  const gaussians::Intrinsics& k = camera.intrinsics;
  const Tensor covered = torch::max_pool2d(alpha.view({1, 1, k.height, k.width}), kEmptyWindow_px,
                                           1, kEmptyWindow_px / 2);
  const auto [mean, uniform] = local_uniformity(image);
  const Tensor bare = covered.view({k.height, k.width}) < kMaxEmptyAlpha;
  const Tensor sky = above_horizon(horizon(camera), k.height, k.width, image.device());
  const Tensor empty = uniform & (bare | sky) & (mean.amax(0) < step::kSaturated);
  const auto subsample = [](const Tensor& t) {
    return t.slice(0, kGridStep_px / 2, t.size(0), kGridStep_px)
        .slice(1, kGridStep_px / 2, t.size(1), kGridStep_px);
  };
  const Tensor at = subsample(empty).nonzero();
  if (at.size(0) == 0) return;
  const auto there = [&](const Tensor& t) {
    return subsample(t).index({at.select(1, 0), at.select(1, 1)}).to(torch::kCPU);
  };
  colors_.push_back(there(mean.permute({1, 2, 0})).to(torch::kFloat64));
  bare_.push_back(there(bare));
  above_.push_back(there(sky));
  const Tensor pixels = (kGridStep_px * at.to(torch::kCPU) + kGridStep_px / 2).to(torch::kFloat64) +
                        0.5;  // row, column
  corners2_.push_back(corners2(k, pixels.select(1, 1), pixels.select(1, 0)));
  views_.push_back(torch::full({at.size(0)}, number, torch::kInt64));
}

medium::Observations OpenWaterCandidates::open_water(const medium::MediumFit& fit,
                                                     const gaussians::ToneCurve& curve) const {
  medium::Observations s;
  s.view_count = fit.log_gains.size(0);
  if (views_.empty()) return s;
  const auto joined = [](const std::vector<Tensor>& parts) {
    const Tensor all = torch::cat(parts);
    return all.slice(0, 0, {}, 1 + all.size(0) / kMaxCandidates).contiguous();
  };
  const Tensor views = joined(views_);
  const Tensor corners = joined(corners2_);
  const Tensor colors = joined(colors_);
  const Tensor response =
      fit.log_gains.exp().index_select(0, views) * fit.vignetting.factor(corners);
  const Tensor water = fit.medium.b_inf;
  const Tensor ratios = (colors / response.unsqueeze(1) / water).clamp_min(1e-6).log();
  Tensor which = uniform_water(ratios, water, joined(above_), kSkyThresholds);
  if (!which.defined()) which = uniform_water(ratios, water, joined(bare_), kEmptyThresholds);
  if (!which.defined()) return s;
  const auto n = which.size(0);
  const auto seen_by = std::get<0>(torch::_unique(views.index_select(0, which))).size(0);
  if (seen_by < kMinViews) return s;
  const auto keep = [&which](const Tensor& t) { return t.index_select(0, which); };
  s.points = torch::arange(n, torch::kInt64);
  s.views = keep(views);
  s.ranges = torch::full({n}, kFarRange_m, torch::kFloat64);
  s.corners2 = keep(corners);
  s.colors = keep(colors);
  s.slopes = curve.slope(s.colors);
  s.texture = torch::zeros({n}, torch::kFloat64);
  s.point_count = n;
  return s;
}

}  // namespace apvi::mapping
