// SPDX-License-Identifier: BSD-3-Clause
#include "change/votes.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "change/neighborhoods.hpp"

namespace apvi::change {
namespace {

using torch::Tensor;

constexpr double kSigmas = 4.0;
constexpr double kBlock_m = 1.0;
constexpr double kMad = 1.4826;   // from median absolute to standard deviation of a normal law
constexpr double kRange_m = 0.3;  // of distances that tell the noise
constexpr double kMinViews = 3.0;
constexpr double kMaxEnough = 8.0;
constexpr double kMajority = 0.75;

Tensor has_majority(const Tensor& votes, const Tensor& others, double enough) {
  return (votes + others >= enough) & (votes >= kMinViews) &
         (votes >= kMajority * (votes + others));
}

/// Mean distances [n] between the surfaces, and their standard deviation: that around each cell, or
/// that of cells with as many views, if it is larger.
struct Distances {
  Tensor mean, noise;
};
Distances distances_of(const SurfaceCells& cells, const Tensor& points,
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
  if (known.numel() == 0) return {sum, sum};
  const auto kept = [&known](const Tensor& t) { return t.index_select(0, known); };
  const Tensor mean = kept(sum / count.clamp_min(1.0)).unsqueeze(1);
  const Tensor support = torch::minimum(count + beyond, cells.views.to(torch::kFloat32));
  const Tensor around = kMad * Neighborhoods(kept(points), kBlock_m).quantiles(mean.abs(), 0.5);
  const Tensor noise = torch::maximum(around, deviations_by_support(mean, kept(support)));
  return {sum / count.clamp_min(1.0),
          torch::zeros_like(sum).index_copy_(0, known, noise.squeeze(1))};
}

}  // namespace

Tensor Votes::decided() const {
  return through + near >= enough;
}
Tensor Votes::changed() const {
  return has_majority(through, near, enough);
}
Tensor Votes::nearly_changed() const {
  return has_majority(weak, near - (weak - through), enough);
}

double enough_views(const Votes& votes) {
  const Tensor all = votes.through + votes.near;
  const Tensor some = all.index({all > 0.0});
  if (some.numel() == 0) return kMinViews;
  return std::clamp(some.median().item<double>() / 3.0, kMinViews, kMaxEnough);
}

Votes vote(const SurfaceCells& cells, const Tensor& points, const std::vector<SurfaceView>& views,
           double least_m) {
  const torch::NoGradGuard no_grad;
  const Tensor zero = torch::zeros_like(points.select(1, 0));
  const Distances distances = distances_of(cells, points, views);
  Votes v{.through = zero.clone(),
          .weak = zero.clone(),
          .near = zero.clone(),
          .relief = distances.mean,
          .noise = distances.noise,
          .distance = zero.clone()};
  for (const SurfaceView& view : views) {
    const Observation s = observation(view, points);
    const Tensor variance = cells.sigma.index_select(0, s.rows).square() +
                            view.sigma.index_select(0, s.pixels).square();
    const Tensor most = torch::maximum(variance.sqrt(), kSigmas * v.noise.index_select(0, s.rows))
                            .clamp_min(least_m);
    const Tensor through = (s.distance > most).to(torch::kFloat32);
    const Tensor near = (s.distance.abs() <= most).to(torch::kFloat32);
    v.through.index_add_(0, s.rows, through);
    v.weak.index_add_(0, s.rows, (s.distance > 0.5 * most).to(torch::kFloat32));
    v.near.index_add_(0, s.rows, near);
    v.distance.index_add_(0, s.rows, through * s.distance);
  }
  v.distance = v.distance / v.through.clamp_min(1.0);
  v.enough = enough_views(v);
  return v;
}

}  // namespace apvi::change
