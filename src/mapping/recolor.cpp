// SPDX-License-Identifier: BSD-3-Clause
#include "recolor.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "apvi/mapping/seeds.hpp"
#include "apvi/mapping/view_gains.hpp"
#include "apvi/splat/ply.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::size_t kMostViews = 32;       // spread over all
constexpr double kUnseen = 1e-4;             // weight of the nearest camera, in view or not
constexpr double kLeastTransmission = 0.05;  // what little light comes through tells no colour

/// `response` [N] of the camera, `points` [N,3] in its frame.
splat::SeenAs through(const std::optional<splat::Medium>& water, const Tensor& response,
                      const Tensor& points) {
  const Tensor g = response.unsqueeze(1);
  if (!water) return {.gain = g.expand({-1, 3}), .veil = torch::zeros_like(g).expand({-1, 3})};
  const splat::SeenAs seen = splat::seen_as(points, *water);
  return {.gain = g * seen.gain.clamp_min(kLeastTransmission), .veil = g * seen.veil};
}

/// Sums of the normal equations of all colours: the new one is (by_old * old + offset) / weight.
struct Sums {
  Tensor weight, by_old, offset;

  explicit Sums(const Tensor& means)
      : weight(torch::zeros_like(means)),
        by_old(torch::zeros_like(means)),
        offset(torch::zeros_like(means)) {}

  /// What a view says of those in `rows` [n], all different, and how much it counts.
  void add(const splat::SeenAs& old, const splat::SeenAs& now, const Tensor& rows, double count) {
    const Tensor a = count * now.gain;
    weight.index_add_(0, rows, a * now.gain);
    by_old.index_add_(0, rows, a * old.gain);
    offset.index_add_(0, rows, a * (old.veil - now.veil));
  }
};

std::vector<std::size_t> some_views(const KeyframeStore& keyframes) {
  const std::vector<std::size_t>& all = keyframes.training();
  const std::size_t stride = std::max<std::size_t>(1, (all.size() + kMostViews - 1) / kMostViews);
  std::vector<std::size_t> some;
  for (std::size_t k = 0; k < all.size(); k += stride) some.push_back(all[k]);
  return some;
}

Tensor gain_of(const Map& map, std::size_t view, const Tensor& like) {
  if (!map.log_gains.defined()) return torch::ones({1}, like.options());
  return map.log_gains.narrow(0, static_cast<std::int64_t>(view), 1).exp().to(like.options());
}

/// Of the lens at pixels [N,2].
Tensor falloff_at(const Map& map, const splat::Intrinsics& k, const Tensor& pixels) {
  return lens_falloff(k, map.vignetting, pixels.select(1, 0), pixels.select(1, 1));
}

}  // namespace

void recolor(const Map& map, const Map& after, const KeyframeStore& keyframes) {
  const torch::NoGradGuard no_grad;
  const Tensor& means = map.gaussians.means;
  if (means.size(0) == 0) return;
  Sums sums(means);
  Tensor nearest =
      torch::full({means.size(0)}, std::numeric_limits<float>::infinity(), means.options());
  Tensor gain_then = torch::ones_like(nearest);
  Tensor gain_now = torch::ones_like(nearest);
  for (const std::size_t i : some_views(keyframes)) {
    splat::View view = keyframes.view(i, 1);
    view.T_camera_world = view.T_camera_world.to(means.options());
    const SeenPoints seen = project(view, means);
    const Tensor ranges = seen.points.norm(2, 1);
    const Tensor then = gain_of(map, i, means);
    const Tensor now = gain_of(after, i, means);
    const Tensor shown = seen.in_view.nonzero().squeeze(1);
    const Tensor pixels = seen.pixels.index_select(0, shown);
    const Tensor points = seen.points.index_select(0, shown);
    sums.add(through(map.medium, then * falloff_at(map, view.intrinsics, pixels), points),
             through(after.medium, now * falloff_at(after, view.intrinsics, pixels), points), shown,
             1.0);
    const Tensor nearer = ranges < nearest;
    nearest = torch::where(nearer, ranges, nearest);
    gain_then = torch::where(nearer, then, gain_then);
    gain_now = torch::where(nearer, now, gain_now);
  }
  const Tensor ahead =
      torch::stack({torch::zeros_like(nearest), torch::zeros_like(nearest), nearest}, 1);
  const Tensor all = torch::arange(means.size(0), means.options().dtype(torch::kInt64));
  sums.add(through(map.medium, gain_then, ahead), through(after.medium, gain_now, ahead), all,
           kUnseen);
  const Tensor factor = sums.by_old / sums.weight;
  const Tensor before = splat::sh_dc_to_color(map.gaussians.sh_dc);
  const Tensor color = factor * before + sums.offset / sums.weight;
  Tensor sh_dc = map.gaussians.sh_dc;
  sh_dc.copy_(splat::color_to_sh_dc(color.clamp_min(0.0)));
  Tensor sh_rest = map.gaussians.sh_rest;
  if (sh_rest.numel() > 0) sh_rest.mul_(factor.unsqueeze(1));
}

}  // namespace apvi::mapping
