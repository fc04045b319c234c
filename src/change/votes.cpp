// SPDX-License-Identifier: BSD-3-Clause
#include "change/votes.hpp"

#include <torch/torch.h>

#include "change/neighborhoods.hpp"

namespace apvi::change {
namespace {

using torch::Tensor;

constexpr double kSigmas = 4.0;
constexpr double kBlock_m = 1.0;
constexpr double kMad = 1.4826;   // from median absolute to standard deviation of a normal law
constexpr double kRange_m = 0.3;  // of distances that tell the noise
constexpr double kMinViews = 3.0;
constexpr double kMajority = 0.75;

Tensor has_majority(const Tensor& votes, const Tensor& others) {
  return (votes >= kMinViews) & (votes >= kMajority * (votes + others));
}

/// Standard deviation [n] of the mean distances between the surfaces: that around each cell, or
/// that of cells with as many views, if it is larger.
Tensor distance_noise(const SurfaceCells& cells, const Tensor& points,
                      const std::vector<SurfaceView>& views) {
  Tensor sum = torch::zeros_like(points.select(1, 0));
  Tensor count = torch::zeros_like(sum);
  Tensor beyond = torch::zeros_like(sum);
  for (const SurfaceView& view : views) {
    const Observation s = observation(view, points);
    const Tensor near = (s.distance.abs() < kRange_m).to(torch::kFloat32);
    sum.index_add_(0, s.rows, near * s.distance);
    count.index_add_(0, s.rows, near);
    beyond.index_add_(0, s.rows, (s.distance >= kRange_m).to(torch::kFloat32));
  }
  const Tensor known = (count > 0.0).nonzero().squeeze(1);
  if (known.numel() == 0) return sum;
  const auto kept = [&known](const Tensor& t) { return t.index_select(0, known); };
  const Tensor mean = kept(sum / count.clamp_min(1.0)).unsqueeze(1);
  const Tensor support = torch::minimum(count + beyond, cells.views.to(torch::kFloat32));
  const Tensor around = kMad * Neighborhoods(kept(points), kBlock_m).quantiles(mean.abs(), 0.5);
  const Tensor noise = torch::maximum(around, deviations_by_support(mean, kept(support)));
  return torch::zeros_like(sum).index_copy_(0, known, noise.squeeze(1));
}

}  // namespace

Tensor Votes::decided() const {
  return through + near >= kMinViews;
}
Tensor Votes::changed() const {
  return has_majority(through, near);
}
Tensor Votes::nearly_changed() const {
  return has_majority(weak, near - (weak - through));
}
Tensor Votes::same() const {
  return has_majority(near, through);
}

Votes vote(const SurfaceCells& cells, const Tensor& points, const std::vector<SurfaceView>& views,
           double least_m) {
  const torch::NoGradGuard no_grad;
  const Tensor zero = torch::zeros_like(points.select(1, 0));
  Votes v{zero.clone(), zero.clone(), zero.clone(), torch::zeros_like(points), zero.clone()};
  const Tensor noise = kSigmas * distance_noise(cells, points, views);
  for (const SurfaceView& view : views) {
    const Observation s = observation(view, points);
    const Tensor variance = cells.sigma.index_select(0, s.rows).square() +
                            view.sigma.index_select(0, s.pixels).square();
    const Tensor most =
        torch::maximum(variance.sqrt(), noise.index_select(0, s.rows)).clamp_min(least_m);
    const Tensor through = (s.distance > most).to(torch::kFloat32);
    const Tensor near = (s.distance.abs() <= most).to(torch::kFloat32);
    v.through.index_add_(0, s.rows, through);
    v.weak.index_add_(0, s.rows, (s.distance > 0.5 * most).to(torch::kFloat32));
    v.near.index_add_(0, s.rows, near);
    v.color.index_add_(0, s.rows, near.unsqueeze(1) * view.color.index_select(0, s.pixels));
    v.distance.index_add_(0, s.rows, through * s.distance);
  }
  v.color = v.color / v.near.clamp_min(1.0).unsqueeze(1);
  v.distance = v.distance / v.through.clamp_min(1.0);
  return v;
}

}  // namespace apvi::change
