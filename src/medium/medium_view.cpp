// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium_view.hpp"

#include <torch/torch.h>

#include "gaussians/render/render.hpp"
#include "medium/medium_backend.hpp"

namespace apvi::medium {
namespace {

using torch::Tensor;

}  // namespace

MediumView::MediumView(const Medium& medium, const gaussians::Intrinsics& camera)
    : medium_(medium) {
  const torch::NoGradGuard no_grad;
  const auto options = medium.beta_d.options().requires_grad(false);
  const Tensor plane = torch::ones({camera.height, camera.width}, options);
  view_data_.ray_lengths = gaussians::depth_to_range(plane, camera).contiguous();
  if (!medium_.lamp) return;
  LampLight& light = *medium_.lamp;
  light.daylight = light.daylight.to(options);
  light.backscatter = light.backscatter.to(options);
  view_data_.lamp_backscatter = lamp_backscatter_table(light, medium.beta_d.detach(), camera);
}

MediumView MediumView::with(const Medium& medium) const {
  MediumView changed = *this;
  changed.medium_.beta_d = medium.beta_d;
  changed.medium_.beta_b = medium.beta_b;
  changed.medium_.b_inf = medium.b_inf;
  changed.open_water_ = Tensor();
  return changed;
}

Tensor MediumView::illumination_at(const Tensor& means, const Tensor& T_camera_world) const {
  if (!medium_.lamp) return {};
  const torch::NoGradGuard no_grad;
  return medium_backend(means.device())
      .lamp_light({.means = means.detach().contiguous(),
                   .T_camera_world = T_camera_world,
                   .lamps = medium_.lamp->lamps,
                   .unit_range_m = medium_.lamp->unit_range_m,
                   .beta_d = medium_.beta_d.detach().contiguous(),
                   .daylight = medium_.lamp->daylight});
}

Tensor MediumView::open_water() const {
  if (open_water_.defined()) return open_water_;
  const torch::NoGradGuard no_grad;
  const Tensor nothing = torch::zeros_like(view_data_.ray_lengths);
  const Tensor black = torch::zeros({nothing.size(0), nothing.size(1), 3}, nothing.options());
  open_water_ = apply_medium(black, nothing, nothing, medium_, view_data_);
  return open_water_;
}

Tensor MediumView::apply(const Tensor& color, const Tensor& depth, const Tensor& alpha) const {
  return apply_medium(color, depth, alpha, medium_, view_data_);
}

}  // namespace apvi::medium
