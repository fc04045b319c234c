// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/rendering.hpp"

#include <torch/torch.h>

#include <algorithm>

#include "apvi/mapping/view_gains.hpp"
#include "apvi/splat/medium_view.hpp"
#include "apvi/splat/render.hpp"

namespace apvi::mapping {

namespace {

std::optional<splat::MediumView> water_before(const Map& map, const splat::Intrinsics& camera) {
  if (!map.medium) return std::nullopt;
  const auto like = [&map](const torch::Tensor& t) { return t.to(map.gaussians.means.options()); };
  return splat::MediumView({.beta_d = like(map.medium->beta_d),
                            .beta_b = like(map.medium->beta_b),
                            .b_inf = like(map.medium->b_inf),
                            .lamp = map.medium->lamp},
                           camera);
}

}  // namespace

Picture take_picture(const Map& map, const splat::View& view) {
  const torch::NoGradGuard no_grad;
  const auto water = water_before(map, view.intrinsics);
  const torch::Tensor light =
      water ? water->light_on(map.gaussians.means, view.T_camera_world) : torch::Tensor();
  const splat::RenderOutput out = splat::render(
      map.gaussians, view, {.antialiased = map.antialiased, .background = {}, .light = light});
  Picture picture = {
      .as_seen = out.color, .restored = out.color, .depth = out.depth, .alpha = out.alpha};
  if (water) picture.as_seen = water->see(out.color, out.depth, out.alpha);
  return picture;
}

torch::Tensor water_alone(const Map& map, const splat::Intrinsics& camera) {
  const auto water = water_before(map, camera);
  return water ? water->open_water() : torch::Tensor();
}

torch::Tensor camera_gain(const Map& map, const KeyframeStore& keyframes, std::size_t i) {
  if (!map.log_gains.defined()) return torch::ones({1}, map.gaussians.means.options());
  const auto log_of = [&map](std::size_t view) {
    return map.log_gains.narrow(0, static_cast<std::int64_t>(view), 1);
  };
  const std::vector<std::size_t>& known = keyframes.training();
  if (!keyframes[i].held_out || known.empty()) return log_of(i).exp();
  const auto after = std::lower_bound(known.begin(), known.end(), i);
  if (after == known.begin()) return log_of(known.front()).exp();
  if (after == known.end()) return log_of(known.back()).exp();
  const auto stamp = [&](std::size_t view) { return keyframes[view].stamp_ns; };
  const std::size_t before = *(after - 1);
  const double share =
      static_cast<double>(stamp(i) - stamp(before)) /
      static_cast<double>(std::max<std::int64_t>(1, stamp(*after) - stamp(before)));
  return torch::lerp(log_of(before), log_of(*after), share).exp();
}

torch::Tensor camera_response(const Map& map, const KeyframeStore& keyframes, std::size_t i,
                              int factor) {
  const torch::Tensor gain = camera_gain(map, keyframes, i);
  if (map.vignetting == 0.0) return gain.view({1, 1, 1});
  return gain * lens_falloff(keyframes.view(i, factor).intrinsics, map.vignetting, gain.device());
}

}  // namespace apvi::mapping
