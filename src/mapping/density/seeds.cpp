// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/seeds.hpp"

#include <torch/torch.h>

#include "gaussians/device.hpp"
#include "gaussians/model/point_cloud.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kMinTransmission = 0.05;  // less light is too noisy to restore a color

// Points [n,3] in the camera's frame.
Tensor in_camera(const gaussians::Intrinsics& k, const Tensor& pixels, const Tensor& depths) {
  const Tensor x = (pixels.select(1, 0) - k.cx) / k.fx * depths;
  const Tensor y = (pixels.select(1, 1) - k.cy) / k.fy * depths;
  return torch::stack({x, y, depths}, 1);
}

Seeds in_scene(const Seeds& seeds, const gaussians::Intrinsics& camera, const Tensor& scene) {
  if (!scene.defined()) return seeds;
  const Tensor index = pixel_index(camera, seeds.pixels);
  return seeds.select(scene.reshape({-1}).index_select(0, index).nonzero().squeeze(1));
}

}  // namespace

Seeds Seeds::select(const Tensor& index) const {
  return {.pixels = pixels.index_select(0, index),
          .depths = depths.index_select(0, index),
          .radii_px = radii_px.index_select(0, index),
          .opacities = opacities.index_select(0, index)};
}

Seeds Seeds::join(const Seeds& a, const Seeds& b) {
  return {.pixels = torch::cat({a.pixels, b.pixels}),
          .depths = torch::cat({a.depths, b.depths}),
          .radii_px = torch::cat({a.radii_px, b.radii_px}),
          .opacities = torch::cat({a.opacities, b.opacities})};
}

Seeds Seeds::none() {
  const Tensor empty = torch::empty({0}, torch::kFloat64);
  return {.pixels = torch::empty({0, 2}, torch::kFloat64),
          .depths = empty,
          .radii_px = empty,
          .opacities = empty};
}

Tensor transform_points(const Tensor& T, const Tensor& points) {
  return points.mm(T.slice(0, 0, 3).slice(1, 0, 3).t()) + T.slice(0, 0, 3).select(1, 3);
}

Tensor pixel_index(const gaussians::Intrinsics& camera, const Tensor& pixels) {
  const Tensor u = pixels.select(1, 0).floor().clamp(0, camera.width - 1).to(torch::kInt64);
  const Tensor v = pixels.select(1, 1).floor().clamp(0, camera.height - 1).to(torch::kInt64);
  return v * camera.width + u;
}

ProjectedPoints project(const gaussians::View& view, const Tensor& positions) {
  const gaussians::Intrinsics& k = view.intrinsics;
  const Tensor p = transform_points(view.T_camera_world, positions);
  const Tensor z = p.select(1, 2);
  const Tensor safe = z.clamp_min(1e-9);
  const Tensor u = p.select(1, 0) / safe * k.fx + k.cx;
  const Tensor v = p.select(1, 1) / safe * k.fy + k.cy;
  return {.points = p,
          .pixels = torch::stack({u, v}, 1),
          .depths = z,
          .in_view = (z > 1e-3) & (u >= 0) & (u < k.width) & (v >= 0) & (v < k.height)};
}

Tensor world_points(const gaussians::View& view, const Tensor& pixels, const Tensor& depths) {
  return transform_points(rigid_inverse(view.T_camera_world),
                          in_camera(view.intrinsics, pixels, depths));
}

gaussians::Gaussians gaussians_from_seeds(const Seeds& seeds, const KeyframeStore& keyframes,
                                          std::size_t view, int sh_degree,
                                          const std::optional<medium::Medium>& medium,
                                          const Tensor& response) {
  const torch::NoGradGuard no_grad;
  const gaussians::View camera = keyframes.view(view, 1);
  const gaussians::Intrinsics& k = camera.intrinsics;
  const Seeds shown = in_scene(seeds, k, keyframes.scene(view, 1, seeds.pixels.device()));
  const std::int64_t n = shown.size();
  const Tensor bytes = keyframes.pixels(view).to(gaussians::active_device()).reshape({-1, 3});
  const auto there = [&bytes](const Tensor& t) { return t.to(bytes.device()); };
  const Tensor pixels = there(shown.pixels);
  const Tensor depths = there(shown.depths);
  const Tensor points = in_camera(k, pixels, depths);
  const Tensor index = pixel_index(k, pixels);
  const Tensor table = keyframes.tone_curve().byte_table(bytes.device());
  Tensor colors = to_float_image(bytes.index_select(0, index), 1, table).to(torch::kFloat64);
  if (response.defined()) {
    const Tensor each = there(response).expand({k.height, k.width, 1}).reshape({-1, 1});
    colors = (colors / each.index_select(0, index).to(torch::kFloat64)).clamp(0.0, 1.0);
  }
  if (medium) colors = remove_medium(colors, points, *medium);
  const Tensor log_scale = (there(shown.radii_px) * depths / k.fx).log().to(torch::kFloat32);
  const Tensor opacity = there(shown.opacities);
  Tensor quaternions = torch::zeros({n, 4}, log_scale.options());
  quaternions.select(1, 0).fill_(1.0);
  return {
      .means =
          transform_points(there(rigid_inverse(camera.T_camera_world)), points).to(torch::kFloat32),
      .log_scales = log_scale.unsqueeze(1).repeat({1, 3}),
      .quaternions = quaternions,
      .logit_opacities = torch::log(opacity / (1.0 - opacity)).to(torch::kFloat32),
      .sh_dc = gaussians::color_to_sh_dc(colors.to(torch::kFloat32)),
      .sh_rest = torch::zeros({n, gaussians::sh_rest_count(sh_degree), 3}, log_scale.options())};
}

Tensor remove_medium(const Tensor& colors, const Tensor& points, const medium::Medium& medium) {
  const medium::MediumTransfer seen = medium::medium_transfer(points.to(colors.options()), medium);
  return ((colors - seen.veiling_light) / seen.gain.clamp_min(kMinTransmission)).clamp(0.0, 1.0);
}

}  // namespace apvi::mapping
