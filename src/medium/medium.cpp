// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium.hpp"

#include <torch/torch.h>

#include "medium/medium_backend.hpp"

namespace apvi::medium {
namespace {

using torch::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

MediumInput to_input(const variable_list& tensors) {
  return {.color = tensors[0].contiguous(),
          .depth = tensors[1].contiguous(),
          .alpha = tensors[2].contiguous(),
          .beta_d = tensors[3].contiguous(),
          .beta_b = tensors[4].contiguous(),
          .b_inf = tensors[5].contiguous(),
          .ray_lengths = tensors[6],
          .lamp_backscatter = tensors[7]};
}

struct ApplyMedium : torch::autograd::Function<ApplyMedium> {
  static Tensor forward(AutogradContext* context, const Tensor& color, const Tensor& depth,
                        const Tensor& alpha, const Tensor& beta_d, const Tensor& beta_b,
                        const Tensor& b_inf, const MediumViewData& view_data) {
    const variable_list inputs = {color,
                                  depth,
                                  alpha,
                                  beta_d,
                                  beta_b,
                                  b_inf,
                                  view_data.ray_lengths,
                                  view_data.lamp_backscatter};
    context->save_for_backward(inputs);
    context->saved_data["with_medium_gradients"] =
        beta_d.requires_grad() || beta_b.requires_grad() || b_inf.requires_grad();
    return medium_backend(color.device()).forward(to_input(inputs));
  }

  static variable_list backward(AutogradContext* context, const variable_list& grads) {
    const MediumInput input = to_input(context->get_saved_variables());
    const bool with_medium_gradients = context->saved_data["with_medium_gradients"].toBool();
    const MediumInput g = medium_backend(input.color.device())
                              .backward(input, grads[0].contiguous(), with_medium_gradients);
    return {g.color, g.depth, g.alpha, g.beta_d, g.beta_b, g.b_inf, Tensor()};
  }
};

void check_like(const Tensor& tensor, const char* name, at::IntArrayRef shape,
                const Tensor& color) {
  TORCH_CHECK(tensor.sizes() == shape, "medium: ", name, " has shape ", tensor.sizes(),
              " instead of ", shape);
  TORCH_CHECK(tensor.scalar_type() == color.scalar_type() && tensor.device() == color.device(),
              "medium: ", name, " is ", tensor.toString(), ", but the image ", color.toString());
}

}  // namespace

Tensor MediumBackend::lamp_light(const LampInput& in) const {
  const Tensor T = in.T_camera_world.to(in.means.options());
  const Tensor points =
      torch::addmm(T.slice(0, 0, 3).select(1, 3), in.means, T.slice(0, 0, 3).slice(1, 0, 3).t());
  return medium::lamp_light({.lamps = in.lamps,
                             .unit_range_m = in.unit_range_m,
                             .daylight = in.daylight,
                             .backscatter = {}},
                            in.beta_d, points);
}

MediumParameters MediumParameters::from(const Medium& medium) {
  TORCH_CHECK((medium.beta_d > 0).all().item<bool>() && (medium.beta_b > 0).all().item<bool>(),
              "medium: beta_d and beta_b must be positive");
  TORCH_CHECK(((medium.b_inf > 0) & (medium.b_inf < 1)).all().item<bool>(),
              "medium: b_inf must lie inside (0, 1)");
  const auto inverse_softplus = [](const Tensor& x) { return x + torch::log(-torch::expm1(-x)); };
  return {.raw_beta_d = inverse_softplus(medium.beta_d),
          .raw_beta_b = inverse_softplus(medium.beta_b),
          .raw_b_inf = torch::logit(medium.b_inf)};
}

Medium MediumParameters::medium() const {
  return {.beta_d = torch::softplus(raw_beta_d),
          .beta_b = torch::softplus(raw_beta_b),
          .b_inf = torch::sigmoid(raw_b_inf)};
}

Tensor apply_medium(const Tensor& color, const Tensor& depth, const Tensor& alpha,
                    const Medium& medium, const MediumViewData& view_data) {
  TORCH_CHECK(color.dim() == 3 && color.size(2) == 3, "medium: the image must be [H,W,3], not ",
              color.sizes());
  check_like(depth, "depth", {color.size(0), color.size(1)}, color);
  check_like(alpha, "alpha", {color.size(0), color.size(1)}, color);
  check_like(medium.beta_d, "beta_d", {3}, color);
  check_like(medium.beta_b, "beta_b", {3}, color);
  check_like(medium.b_inf, "b_inf", {3}, color);
  if (view_data.ray_lengths.defined()) {
    check_like(view_data.ray_lengths, "ray_lengths", depth.sizes(), color);
  }
  if (const Tensor& lamp_backscatter = view_data.lamp_backscatter; lamp_backscatter.defined()) {
    TORCH_CHECK(lamp_backscatter.dim() == 5 && lamp_backscatter.is_contiguous() &&
                    lamp_backscatter.size(2) > 1 && lamp_backscatter.size(3) > 1,
                "medium: the lamp backscatter must be a table, not shape ",
                lamp_backscatter.sizes());
    check_like(lamp_backscatter, "lamp_backscatter",
               {1, 3, lamp_backscatter.size(2), lamp_backscatter.size(3), lamp_backscatter.size(3)},
               color);
  }
  return ApplyMedium::apply(color, depth, alpha, medium.beta_d, medium.beta_b, medium.b_inf,
                            view_data);
}

MediumTransfer medium_transfer(const Tensor& points, const Medium& medium) {
  const torch::NoGradGuard no_grad;
  const auto like = [&points](const Tensor& t) { return t.detach().to(points.options()); };
  const Tensor beta_d = like(medium.beta_d);
  const Tensor range = points.norm(2, 1, true);
  MediumTransfer seen = {
      .gain = torch::exp(-beta_d * range),
      .veiling_light = like(medium.b_inf) * (1.0 - torch::exp(-like(medium.beta_b) * range))};
  if (!medium.lamp) return seen;
  const LampLight& light = *medium.lamp;
  seen.gain = seen.gain * lamp_light(light, beta_d, points);
  const Tensor rays = points / range.clamp_min(1e-9);
  seen.veiling_light =
      seen.veiling_light + like(light.backscatter) * LampSum::backscatter(light.lamps,
                                                                          light.unit_range_m, rays,
                                                                          range.squeeze(1))
                                                         .at(beta_d, light.lamps)
                                                         .value;
  return seen;
}

}  // namespace apvi::medium
