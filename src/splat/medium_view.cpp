// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/splat/medium_view.hpp"

#include <torch/torch.h>

#include "apvi/splat/medium_backend.hpp"
#include "apvi/splat/render.hpp"

namespace apvi::splat {
namespace {

using torch::Tensor;

constexpr double kSolid = 0.5;  // alpha above which a ray ends at a surface

/// Places -1 to 1 of the centres of `count` pixels.
Tensor places(int count, const torch::TensorOptions& options) {
  return (torch::arange(count, options) + 0.5) * (2.0 / static_cast<double>(count)) - 1.0;
}

}  // namespace

MediumView::MediumView(const Medium& medium, const Intrinsics& camera) : medium_(medium) {
  const torch::NoGradGuard no_grad;
  const auto options = medium.beta_d.options().requires_grad(false);
  const std::int64_t h = camera.height;
  const std::int64_t w = camera.width;
  ray_lengths_ = depth_to_range(torch::ones({h, w}, options), camera);
  if (!medium_.lamp) return;
  LampLight& light = *medium_.lamp;
  light.daylight = light.daylight.to(options);
  light.glow = light.glow.to(options);
  haze_ = lamp_haze_table(light, medium.beta_d.detach(), camera);
  columns_ = places(camera.width, options).expand({h, w}).contiguous();
  rows_ = places(camera.height, options).unsqueeze(1).expand({h, w}).contiguous();
}

MediumView MediumView::with(const Medium& medium) const {
  MediumView changed = *this;
  changed.medium_.beta_d = medium.beta_d;
  changed.medium_.beta_b = medium.beta_b;
  changed.medium_.b_inf = medium.b_inf;
  return changed;
}

Tensor MediumView::light_on(const Tensor& means, const Tensor& T_camera_world) const {
  if (!medium_.lamp) return {};
  const torch::NoGradGuard no_grad;
  return medium_backend(means.device())
      .lamp_light({.means = means.detach().contiguous(),
                   .T_camera_world = T_camera_world,
                   .lamp = medium_.lamp->lamp,
                   .unit_range_m = medium_.lamp->unit_range_m,
                   .beta_d = medium_.beta_d.detach().contiguous(),
                   .daylight = medium_.lamp->daylight});
}

// Where nothing is drawn, the ray goes on through water.
Tensor MediumView::glow_before(const Tensor& range, const Tensor& alpha) const {
  const torch::NoGradGuard no_grad;
  const Tensor end = range.masked_fill(alpha < kSolid, kLampReach_m);
  const Tensor steps = 2.0 * lamp_haze_step(end) - 1.0;
  const Tensor at = torch::stack({columns_, rows_, steps}, 2);
  constexpr std::int64_t kLinear = 0;
  constexpr std::int64_t kBorder = 1;
  const std::int64_t h = range.size(0);
  const std::int64_t w = range.size(1);
  return torch::grid_sampler(haze_, at.view({1, 1, h, w, 3}), kLinear, kBorder,
                             /*align_corners=*/true)
      .view({3, h, w})
      .permute({1, 2, 0});
}

Tensor MediumView::open_water() const {
  const torch::NoGradGuard no_grad;
  const Tensor nothing = torch::zeros_like(ray_lengths_);
  const Tensor veil = medium_.b_inf.detach().expand({nothing.size(0), nothing.size(1), 3});
  return medium_.lamp ? veil + glow_before(nothing, nothing) : veil;
}

Tensor MediumView::see(const Tensor& color, const Tensor& depth, const Tensor& alpha) const {
  TORCH_CHECK(depth.sizes() == ray_lengths_.sizes(), "medium: a depth of shape ", depth.sizes(),
              " for a camera of ", ray_lengths_.sizes());
  const Tensor range = depth * ray_lengths_;
  Tensor image = apply_medium(color, range, alpha, medium_);
  if (!medium_.lamp) return image;
  return image + glow_before(range.detach(), alpha.detach());
}

}  // namespace apvi::splat
