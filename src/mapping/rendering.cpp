// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/rendering.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "gaussians/render/render.hpp"
#include "mapping/appearance/illumination.hpp"
#include "mapping/appearance/view_gains.hpp"
#include "medium/medium_view.hpp"

namespace apvi::mapping {

namespace {

std::optional<medium::MediumView> medium_view(const Map& map, const gaussians::Intrinsics& camera) {
  if (!map.medium) return std::nullopt;
  const auto like = [&map](const torch::Tensor& t) { return t.to(map.gaussians.means.options()); };
  return medium::MediumView({.beta_d = like(map.medium->beta_d),
                             .beta_b = like(map.medium->beta_b),
                             .b_inf = like(map.medium->b_inf),
                             .lamp = map.medium->lamp},
                            camera);
}

/// Entry `i` of `values` [n,...]; for a held-out image, interpolated in time between the training
/// images before and after it.
torch::Tensor value_of(const torch::Tensor& values, const KeyframeStore& keyframes, std::size_t i) {
  const auto at = [&values](std::size_t view) {
    return values.select(0, static_cast<std::int64_t>(view));
  };
  const std::vector<std::size_t>& training = keyframes.training();
  if (!keyframes[i].held_out || training.empty()) return at(i);
  const auto stamp = [&](std::size_t view) { return keyframes[view].stamp_ns; };
  const auto after =
      std::lower_bound(training.begin(), training.end(), stamp(i),
                       [&](std::size_t view, std::int64_t taken) { return stamp(view) < taken; });
  if (after == training.begin()) return at(training.front());
  if (after == training.end()) return at(training.back());
  const std::size_t before = *(after - 1);
  const double fraction =
      static_cast<double>(stamp(i) - stamp(before)) /
      static_cast<double>(std::max<std::int64_t>(1, stamp(*after) - stamp(before)));
  return torch::lerp(at(before), at(*after), fraction);
}

}  // namespace

MapRendering render_map(const Map& map, const gaussians::View& view) {
  const torch::NoGradGuard no_grad;
  const auto water = medium_view(map, view.intrinsics);
  const torch::Tensor light =
      water ? water->illumination_at(map.gaussians.means, view.T_camera_world) : torch::Tensor();
  const gaussians::RenderOutput out = gaussians::render(
      map.gaussians, view, {.antialiased = map.antialiased, .background = {}, .light = light});
  MapRendering rendering = {
      .color = out.color, .restored = out.color, .depth = out.depth, .alpha = out.alpha};
  if (map.light.defined()) rendering.color = out.color * map.light.to(out.color.options());
  if (water) rendering.color = water->apply(rendering.color, out.depth, out.alpha);
  return rendering;
}

torch::Tensor with_water(const Map& map, const gaussians::Intrinsics& camera,
                         const MapRendering& rendering, double amount) {
  const torch::NoGradGuard no_grad;
  if (!map.medium || amount == 1.0) return rendering.color;
  torch::Tensor color = map.light.defined()
                            ? rendering.restored * map.light.to(rendering.restored.options())
                            : rendering.restored;
  if (amount <= 0.0) return color;
  Map other{.gaussians = map.gaussians, .medium = map.medium};
  other.medium->beta_d = map.medium->beta_d * amount;
  other.medium->beta_b = map.medium->beta_b * amount;
  return medium_view(other, camera)->apply(color, rendering.depth, rendering.alpha);
}

torch::Tensor render_open_water(const Map& map, const gaussians::Intrinsics& camera) {
  const auto water = medium_view(map, camera);
  return water ? water->open_water() : torch::Tensor();
}

torch::Tensor camera_gain(const Map& map, const KeyframeStore& keyframes, std::size_t i) {
  if (!map.log_gains.defined()) return torch::ones({1}, map.gaussians.means.options());
  return value_of(map.log_gains.unsqueeze(1), keyframes, i).exp();
}

torch::Tensor camera_response(const Map& map, const KeyframeStore& keyframes, std::size_t i,
                              int factor) {
  torch::Tensor response = camera_gain(map, keyframes, i).view({1, 1, 1});
  const gaussians::Intrinsics camera = keyframes.view(i, factor).intrinsics;
  if (map.illumination.defined()) {
    response =
        response * illumination_gain(value_of(map.illumination, keyframes, i),
                                     1.0 / map.tone_curve.exponent(), camera.height, camera.width);
  }
  if (map.vignetting.is_none()) return response;
  return response * lens_falloff(camera, map.vignetting, response.device());
}

}  // namespace apvi::mapping
