// SPDX-License-Identifier: BSD-3-Clause
// A sea bed of Gaussians, and analytic images of it through water.
#pragma once

#include <torch/torch.h>

#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/model/point_cloud.hpp"
#include "gaussians/render/view.hpp"
#include "mapping/appearance/view_gains.hpp"
#include "mapping/density/seeds.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "medium/lamp.hpp"
#include "medium/medium.hpp"
#include "medium/vignetting.hpp"

namespace apvi::mapping {

using torch::Tensor;

inline constexpr medium::Vignetting kVignetting{.square = 0.2, .fourth = 0.05};
inline constexpr double kRelief = 0.1;  // [m] of the sea bed

inline medium::Medium true_water() {
  return {.beta_d = torch::tensor({0.30, 0.14, 0.16}),
          .beta_b = torch::tensor({0.29, 0.135, 0.15}),
          .b_inf = torch::tensor({0.05, 0.20, 0.18})};
}

/// Height (y, down) of the sea bed below the world's origin.
inline Tensor height_at(const Tensor& x, const Tensor& z) {
  return 1.0 + kRelief * torch::sin(1.3 * x) * torch::cos(1.1 * z);
}

/// Smooth colors [...,3].
inline Tensor color_at(const Tensor& x, const Tensor& z) {
  const Tensor phase = torch::tensor({0.0, 2.0, 4.0}, x.options());
  return 0.45 + 0.35 * torch::sin(2.1 * x.unsqueeze(-1) + phase) *
                    torch::cos(1.7 * z.unsqueeze(-1) - 0.5 * phase);
}

/// A sea bed 8 m wide and 12 m long, about two meters below the cameras, of small Gaussians: the
/// rendered depth of large ones is biased toward the camera.
inline gaussians::Gaussians sea_bed() {
  const Tensor x = torch::linspace(-4.0, 4.0, 241).reshape({241, 1}).expand({241, 361}).flatten();
  const Tensor z = torch::linspace(0.0, 12.0, 361).reshape({1, 361}).expand({241, 361}).flatten();
  const std::int64_t n = x.size(0);
  return {.means = torch::stack({x, height_at(x, z), z}, 1),
          .log_scales = torch::tensor({0.025, 0.005, 0.025}).log().repeat({n, 1}),
          .quaternions = torch::tensor({1.0F, 0.0F, 0.0F, 0.0F}).repeat({n, 1}),
          .logit_opacities = torch::full({n}, 4.0F),
          .sh_dc = gaussians::color_to_sh_dc(color_at(x, z)),
          .sh_rest = torch::zeros({n, 0, 3})};
}

inline Tensor pose_at(double x, double y, double z, double pitch) {
  const Tensor R = torch::tensor({1.0, 0.0, 0.0,                           //
                                  0.0, std::cos(pitch), -std::sin(pitch),  //
                                  0.0, std::sin(pitch), std::cos(pitch)},
                                 torch::kFloat64)
                       .reshape({3, 3});
  Tensor T = torch::eye(4, torch::kFloat64);
  T.slice(0, 0, 3).slice(1, 0, 3).copy_(R);
  T.slice(0, 0, 3).select(1, 3).copy_(-torch::matmul(R, torch::tensor({x, y, z}, torch::kFloat64)));
  return T;
}

inline double log_gain_of(int i) {
  return 0.2 * std::sin(1.1 * i);
}

/// Fine sand texture [...,1] for depth estimation.
inline Tensor grain_at(const Tensor& x, const Tensor& z) {
  const Tensor grain = torch::sin(31.0 * x + 5.0 * torch::sin(7.0 * z)) *
                       torch::cos(27.0 * z + 4.0 * torch::sin(9.0 * x));
  return (1.0 + 0.3 * grain).unsqueeze(-1);
}

/// Illumination [H,W,3] of the bed's points [H,W,3] in the world frame, a tenth of it daylight.
inline Tensor lamplight(const medium::Lamp& lamp, const gaussians::View& view,
                        const Tensor& point) {
  const Tensor T = view.T_camera_world;
  const Tensor in_camera =
      torch::matmul(point, T.slice(0, 0, 3).slice(1, 0, 3).t()) + T.slice(0, 0, 3).select(1, 3);
  const Tensor x = point.select(2, 0);
  const Tensor z = point.select(2, 2);
  const Tensor up =
      torch::stack({1.3 * kRelief * torch::cos(1.3 * x) * torch::cos(1.1 * z), -torch::ones_like(x),
                    -1.1 * kRelief * torch::sin(1.3 * x) * torch::sin(1.1 * z)},
                   2);
  const Tensor rays = point - camera_center(T);
  const Tensor cosine = (rays * up).sum(2).abs() / (rays.norm(2, 2) * up.norm(2, 2));
  const Tensor irradiance = medium::LampSum::irradiance({lamp}, 2.0, in_camera)
                                .at(true_water().beta_d.to(torch::kFloat64), {lamp})
                                .value;
  return 0.1 + 0.9 * irradiance * cosine.unsqueeze(2);
}

/// Analytic image of the bed, with exact ranges per pixel, as the rendered depth of Gaussians
/// varies slightly with the viewing angle.
inline Tensor bed_through_water(const gaussians::View& view,
                                const std::optional<medium::Lamp>& lamp) {
  const gaussians::Intrinsics& k = view.intrinsics;
  const Tensor R = view.T_camera_world.slice(0, 0, 3).slice(1, 0, 3);
  const Tensor origin = camera_center(view.T_camera_world);
  const Tensor u = (torch::arange(k.width, torch::kFloat64) + 0.5 - k.cx) / k.fx;
  const Tensor v = (torch::arange(k.height, torch::kFloat64) + 0.5 - k.cy) / k.fy;
  const Tensor ones = torch::ones({k.height, k.width}, torch::kFloat64);
  const Tensor in_camera = torch::stack({ones * u, ones * v.unsqueeze(1), ones}, 2);
  const Tensor ray = torch::matmul(in_camera / in_camera.norm(2, 2, true), R);
  Tensor range = torch::ones_like(ones);
  Tensor point;
  for (int i = 0; i < 30; ++i) {
    point = origin + range.unsqueeze(2) * ray;
    const Tensor below = height_at(point.select(2, 0), point.select(2, 2)) - point.select(2, 1);
    range = (range + below / ray.select(2, 1).clamp_min(0.1)).clamp(0.0, 30.0);
  }
  const Tensor x = point.select(2, 0);
  const Tensor z = point.select(2, 2);
  const Tensor hit = (ray.select(2, 1) > 0.1) & (x.abs() < 4.0) & (z > 0.0) & (z < 12.0);
  Tensor color = color_at(x, z);
  if (lamp) color = color * grain_at(x, z) * lamplight(*lamp, view, point);
  return medium::apply_medium(
      (color * hit.unsqueeze(2)).to(torch::kFloat32),
      torch::where(hit, range, torch::full_like(range, 100.0)).to(torch::kFloat32),
      hit.to(torch::kFloat32), true_water());
}

inline constexpr double kDownwards = 0.75;
inline constexpr double kAhead = 0.3;  // pitch that includes open water beyond the bed

/// Images through water of an auto-exposing camera that looks down by about `pitch`, with a tone
/// curve.
inline KeyframeStore dive(double pitch = kDownwards, const std::optional<medium::Lamp>& lamp = {},
                          int count = 14, const gaussians::ToneCurve& curve = {}) {
  const torch::NoGradGuard no_grad;
  KeyframeStore store;
  const double pace = 14.0 / count;
  for (int i = 0; i < count; ++i) {
    Keyframe keyframe;
    keyframe.stamp_ns = i;
    keyframe.name = std::to_string(i);
    keyframe.intrinsics = {
        .fx = 110.0, .fy = 110.0, .cx = 80.0, .cy = 60.0, .width = 160, .height = 120};
    keyframe.T_camera_world =
        pose_at(0.8 * std::sin(1.7 * pace * i), 0.3 * std::cos(2.3 * pace * i) - 0.8,
                0.35 * pace * i, pitch + 0.1 * (i % 3));
    gaussians::View view;
    view.intrinsics = keyframe.intrinsics;
    view.T_camera_world = keyframe.T_camera_world;
    const Tensor response =
        std::exp(log_gain_of(i)) * lens_falloff(view.intrinsics, kVignetting, torch::kCPU);
    const Tensor light = (bed_through_water(view, lamp) * response).clamp(0.0, 1.0);
    keyframe.image = (curve.encode(light) * 255.0 + 0.5).to(torch::kUInt8);
    store.add(std::move(keyframe));
  }
  return store;
}

}  // namespace apvi::mapping
