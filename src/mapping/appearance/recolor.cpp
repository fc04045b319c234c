// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/appearance/recolor.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "gaussians/model/point_cloud.hpp"
#include "mapping/appearance/view_gains.hpp"
#include "mapping/density/seeds.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::size_t kMaxRecolorViews = 32;  // evenly spread
constexpr double kUnseenWeight = 1e-4;     // of the nearest camera, for Gaussians outside all views
constexpr double kMinTransmission = 0.05;  // less light is too noisy to restore a color

/// Gain and veiling light of `points` [N,3] in the camera's frame; `response` [N] of the camera.
medium::MediumTransfer observed_transfer(const std::optional<medium::Medium>& water,
                                         const Tensor& response, const Tensor& points) {
  const Tensor g = response.unsqueeze(1);
  if (!water) {
    return {.gain = g.expand({-1, 3}), .veiling_light = torch::zeros_like(g).expand({-1, 3})};
  }
  const medium::MediumTransfer seen = medium::medium_transfer(points, *water);
  return {.gain = g * seen.gain.clamp_min(kMinTransmission),
          .veiling_light = g * seen.veiling_light};
}

/// `old` for light by another tone curve, to first order about the colors `J` [N,3].
medium::MediumTransfer with_curve(const medium::MediumTransfer& old, const Tensor& J,
                                  const gaussians::ToneCurve& from,
                                  const gaussians::ToneCurve& to) {
  if (from == to) return old;
  const Tensor light = old.gain * J + old.veiling_light;
  const Tensor changed = to.decode(from.encode(light));
  const Tensor gain = old.gain * from.slope(light) / to.slope(changed);
  return {.gain = gain, .veiling_light = changed - gain * J};
}

/// Normal equations of all colors: new = (scale * old + offset) / weight.
struct Sums {
  Tensor weight, scale, offset;

  explicit Sums(const Tensor& means)
      : weight(torch::zeros_like(means)),
        scale(torch::zeros_like(means)),
        offset(torch::zeros_like(means)) {}

  /// Adds one view for the Gaussians `rows` [n] (unique), with weight `count`.
  void add(const medium::MediumTransfer& old, const medium::MediumTransfer& now, const Tensor& rows,
           double count) {
    const Tensor a = count * now.gain;
    weight.index_add_(0, rows, a * now.gain);
    scale.index_add_(0, rows, a * old.gain);
    offset.index_add_(0, rows, a * (old.veiling_light - now.veiling_light));
  }
};

std::vector<std::size_t> select_views(const std::vector<std::size_t>& all) {
  const std::size_t stride =
      std::max<std::size_t>(1, (all.size() + kMaxRecolorViews - 1) / kMaxRecolorViews);
  std::vector<std::size_t> selected;
  for (std::size_t k = 0; k < all.size(); k += stride) selected.push_back(all[k]);
  return selected;
}

Tensor gain_of(const Map& map, std::size_t view, const Tensor& like) {
  if (!map.log_gains.defined()) return torch::ones({1}, like.options());
  return map.log_gains.narrow(0, static_cast<std::int64_t>(view), 1).exp().to(like.options());
}

/// Lens falloff at pixels [N,2].
Tensor falloff_at(const Map& map, const gaussians::Intrinsics& k, const Tensor& pixels) {
  return lens_falloff(k, map.vignetting, pixels.select(1, 0), pixels.select(1, 1));
}

}  // namespace

void recolor(const Map& map, const Map& after, const KeyframeStore& keyframes,
             const std::vector<std::size_t>& views) {
  const torch::NoGradGuard no_grad;
  const Tensor& means = map.gaussians.means;
  if (means.size(0) == 0) return;
  Sums sums(means);
  const Tensor before = gaussians::sh_dc_to_color(map.gaussians.sh_dc);
  const auto seen_now = [&](const medium::MediumTransfer& old, const Tensor& J) {
    return with_curve(old, J, map.tone_curve, after.tone_curve);
  };
  Tensor nearest =
      torch::full({means.size(0)}, std::numeric_limits<float>::infinity(), means.options());
  Tensor nearest_old_gain = torch::ones_like(nearest);
  Tensor nearest_new_gain = torch::ones_like(nearest);
  for (const std::size_t i : select_views(views)) {
    gaussians::View view = keyframes.view(i, 1);
    view.T_camera_world = view.T_camera_world.to(means.options());
    const ProjectedPoints seen = project(view, means);
    const Tensor ranges = seen.points.norm(2, 1);
    const Tensor old_gain = gain_of(map, i, means);
    const Tensor new_gain = gain_of(after, i, means);
    const Tensor visible = seen.in_view.nonzero().squeeze(1);
    const Tensor pixels = seen.pixels.index_select(0, visible);
    const Tensor points = seen.points.index_select(0, visible);
    const medium::MediumTransfer old =
        observed_transfer(map.medium, old_gain * falloff_at(map, view.intrinsics, pixels), points);
    sums.add(seen_now(old, before.index_select(0, visible)),
             observed_transfer(after.medium, new_gain * falloff_at(after, view.intrinsics, pixels),
                               points),
             visible, 1.0);
    const Tensor nearer = ranges < nearest;
    nearest = torch::where(nearer, ranges, nearest);
    nearest_old_gain = torch::where(nearer, old_gain, nearest_old_gain);
    nearest_new_gain = torch::where(nearer, new_gain, nearest_new_gain);
  }
  const Tensor ahead =
      torch::stack({torch::zeros_like(nearest), torch::zeros_like(nearest), nearest}, 1);
  const Tensor all = torch::arange(means.size(0), means.options().dtype(torch::kInt64));
  sums.add(seen_now(observed_transfer(map.medium, nearest_old_gain, ahead), before),
           observed_transfer(after.medium, nearest_new_gain, ahead), all, kUnseenWeight);
  const Tensor factor = sums.scale / sums.weight;
  const Tensor color = factor * before + sums.offset / sums.weight;
  Tensor sh_dc = map.gaussians.sh_dc;
  sh_dc.copy_(gaussians::color_to_sh_dc(color.clamp_min(0.0)));
  Tensor sh_rest = map.gaussians.sh_rest;
  if (sh_rest.numel() > 0) sh_rest.mul_(factor.unsqueeze(1));
}

std::vector<std::size_t> anchor_views(const Tensor& anchors, const KeyframeStore& keyframes) {
  const Tensor unique = std::get<0>(at::_unique(anchors.to(torch::kCPU)));
  const auto* const first = unique.data_ptr<std::int64_t>();
  const auto count = static_cast<std::int64_t>(keyframes.size());
  std::vector<std::size_t> views;
  for (std::int64_t k = 0; k < unique.numel(); ++k) {
    if (first[k] >= 0 && first[k] < count) views.push_back(static_cast<std::size_t>(first[k]));
  }
  return views.empty() ? keyframes.training() : views;
}

}  // namespace apvi::mapping
