// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/medium/range_bias.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>

#include "core/random.hpp"
#include "mapping/appearance/view_gains.hpp"
#include "mapping/medium/surface_observations.hpp"
#include "medium/medium.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::size_t kMaxViews = 32;  // evenly spread
constexpr std::int64_t kPointCount = 3000;
constexpr std::int64_t kMinPoints = 50;
constexpr double kMinRelativeSpread = 0.03;
constexpr double kDarkest = 0.01;  // of an image color; less is noise
constexpr double kFloor = 1e-3;    // of a restored color: more than its light was removed
constexpr int kIterations = 10;
constexpr double kHuber = 1.345;  // [standard deviations]

std::vector<std::size_t> spread(const std::vector<std::size_t>& views) {
  const std::size_t stride = (views.size() + kMaxViews - 1) / kMaxViews;
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < views.size(); k += stride) chosen.push_back(views[k]);
  return chosen;
}

medium::Observations observe(const Map& map, const KeyframeStore& keyframes,
                             const std::vector<std::size_t>& views) {
  std::vector<SampledView> sampled;
  Random random(1);
  std::vector<Tensor> points, normals;
  for (const std::size_t i : views) {
    sampled.push_back(sample_view(map, keyframes, i, 0));
    sample_points(sampled.back(), kPointCount / static_cast<std::int64_t>(views.size()), false,
                  random);
    points.push_back(sampled.back().points);
    normals.push_back(sampled.back().normals);
  }
  const Tensor all_points = torch::cat(points);
  const Tensor all_normals = torch::cat(normals);
  const Tensor numbers = torch::arange(all_points.size(0), torch::kInt64);
  ObservationCollector collector(keyframes, map.tone_curve, map.gaussians.means.device(),
                                 patch_size(sampled));
  for (std::size_t j = 0; j < sampled.size(); ++j) {
    collector.add(sampled[j], static_cast<std::int64_t>(j), all_points, all_normals, all_normals,
                  numbers);
  }
  return collector.observations(all_points.size(0), static_cast<std::int64_t>(views.size()));
}

/// Response of the camera [n,1]: exposure gain and vignetting.
Tensor response_of(const Map& map, const KeyframeStore& keyframes,
                   const std::vector<std::size_t>& views, const medium::Observations& o) {
  std::vector<Tensor> gains;
  for (const std::size_t i : views)
    gains.push_back(camera_gain(map, keyframes, i).to(torch::kCPU, torch::kFloat64));
  const Tensor falloff = map.vignetting.factor(o.corners2).clamp_min(0.05);
  return (torch::cat(gains).index_select(0, o.views) * falloff).unsqueeze(1);
}

/// `values` [n] minus their weighted mean over the observations of each point.
Tensor centered(const Tensor& values, const Tensor& weights, const medium::Observations& o) {
  const auto sum = [&o](const Tensor& t) {
    return torch::zeros({o.point_count}, torch::kFloat64).index_add_(0, o.points, t);
  };
  const Tensor mean = sum(weights * values) / sum(weights).clamp_min(1e-12);
  return values - mean.index_select(0, o.points);
}

/// Slope of `logs` [n] against range; observations of weight zero are left out. Robust: Huber's
/// weights by iterated least squares.
double slope(const Tensor& logs, const Tensor& used, const medium::Observations& o) {
  Tensor weights = used;
  double result = 0.0;
  for (int k = 0; k < kIterations; ++k) {
    const Tensor range = centered(o.ranges, weights, o);
    const Tensor color = centered(logs, weights, o);
    result = ((weights * range * color).sum() / (weights * range.square()).sum().clamp_min(1e-12))
                 .item<double>();
    const Tensor residual = (color - result * range).abs();
    const Tensor kept = residual.index({used > 0.0});
    if (kept.numel() == 0) return 0.0;
    const double scale = std::max(1e-6, 1.4826 * kept.median().item<double>());
    weights = used * (kHuber * scale / residual.clamp_min(1e-12)).clamp_max(1.0);
  }
  return result;
}

}  // namespace

std::optional<RangeBias> range_bias(const Map& map, const KeyframeStore& keyframes,
                                    const std::vector<std::size_t>& views) {
  if (!map.medium || views.size() < 3) return std::nullopt;
  const torch::NoGradGuard no_grad;
  const std::vector<std::size_t> chosen = spread(views);
  const medium::Observations o = observe(map, keyframes, chosen);
  if (o.point_count < kMinPoints) return std::nullopt;
  const Tensor all = torch::ones_like(o.ranges);
  const Tensor deviation = centered(o.ranges, all, o);
  RangeBias bias;
  bias.points = o.point_count;
  bias.observations = o.ranges.size(0);
  bias.range_spread_m = deviation.square().mean().sqrt().item<double>();
  if (bias.range_spread_m < kMinRelativeSpread * o.ranges.mean().item<double>())
    return std::nullopt;
  const medium::MediumTransfer seen = medium::medium_transfer(o.places, *map.medium);
  const Tensor colors = o.colors / response_of(map, keyframes, chosen, o);
  const Tensor restored = (colors - seen.veiling_light) / seen.gain;
  for (std::int64_t c = 0; c < 3; ++c) {
    const Tensor used = (o.colors.select(1, c) > kDarkest).to(torch::kFloat64);
    const auto k = static_cast<std::size_t>(c);
    bias.image[k] = slope(o.colors.select(1, c).clamp_min(kFloor).log(), used, o);
    bias.restored[k] = slope(restored.select(1, c).clamp_min(kFloor).log(), used, o);
  }
  return bias;
}

}  // namespace apvi::mapping
