// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/render/tone_curve.hpp"

#include <torch/torch.h>

#include <cmath>

#include "gaussians/model/point_cloud.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;
using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr double kPowerToe = 1e-3;  // light below which a curve without offset is linear
constexpr double kMediumLight = 0.2;
constexpr std::int64_t kBytes = 256;

double power_value(const ToneCurve& curve, double light) {
  return (1.0 + curve.offset) * std::pow(light, 1.0 / curve.gamma) - curve.offset;
}

/// Light below which the curve is a line. With an offset, the line is tangential (as in sRGB).
double toe_of(const ToneCurve& curve) {
  if (curve.offset == 0.0) return kPowerToe;
  const double root = curve.offset / ((1.0 + curve.offset) * (1.0 - 1.0 / curve.gamma));
  return std::pow(root, curve.gamma);
}

double toe_slope(const ToneCurve& curve) {
  return power_value(curve, toe_of(curve)) / toe_of(curve);
}

Tensor encoded(const ToneCurve& curve, const Tensor& light) {
  const double toe = toe_of(curve);
  const Tensor bright =
      (1.0 + curve.offset) * light.clamp_min(toe).pow(1.0 / curve.gamma) - curve.offset;
  return torch::where(light < toe, toe_slope(curve) * light, bright);
}

/// One saved tensor instead of those of every operator.
struct Encode : torch::autograd::Function<Encode> {
  static Tensor forward(AutogradContext* context, const Tensor& light, double gamma,
                        double offset) {
    context->save_for_backward({light});
    context->saved_data["gamma"] = gamma;
    context->saved_data["offset"] = offset;
    return encoded({.gamma = gamma, .offset = offset}, light);
  }

  static variable_list backward(AutogradContext* context, const variable_list& grads) {
    const ToneCurve curve{.gamma = context->saved_data["gamma"].toDouble(),
                          .offset = context->saved_data["offset"].toDouble()};
    return {grads[0] * curve.slope(context->get_saved_variables()[0]), Tensor(), Tensor()};
  }
};

/// Colors `changed`, with view dependence scaled by `factor` [N,3].
Gaussians recolored(const Gaussians& gaussians, const Tensor& changed, const Tensor& factor) {
  Gaussians result = gaussians;
  result.sh_dc = color_to_sh_dc(changed);
  if (gaussians.sh_rest.numel() > 0) result.sh_rest = gaussians.sh_rest * factor.unsqueeze(1);
  return result;
}

}  // namespace

Tensor ToneCurve::encode(const Tensor& light) const {
  return is_linear() ? light : Encode::apply(light, gamma, offset);
}

Tensor ToneCurve::decode(const Tensor& values) const {
  if (is_linear()) return values;
  const double dark = power_value(*this, toe_of(*this));
  const Tensor bright = ((values.clamp_min(dark) + offset) / (1.0 + offset)).pow(gamma);
  return torch::where(values < dark, values / toe_slope(*this), bright);
}

Tensor ToneCurve::slope(const Tensor& light) const {
  if (is_linear()) return torch::ones_like(light);
  const double toe = toe_of(*this);
  const Tensor bright = (1.0 + offset) / gamma * light.clamp_min(toe).pow(1.0 / gamma - 1.0);
  return torch::where(light < toe, toe_slope(*this), bright);
}

double ToneCurve::exponent() const {
  return (1.0 + offset / power_value(*this, kMediumLight)) / gamma;
}

Tensor ToneCurve::byte_table(const torch::Device& device) const {
  if (is_linear()) return {};
  const Tensor bytes = torch::arange(kBytes, torch::kFloat64);
  return decode(bytes / static_cast<double>(kBytes - 1)).to(torch::kFloat32).to(device);
}

Tensor to_tensor(const ToneCurve& curve) {
  return torch::tensor({curve.gamma, curve.offset}, torch::kFloat64);
}

ToneCurve tone_curve_of(const Tensor& values) {
  TORCH_CHECK(values.numel() == 2 && values.scalar_type() == torch::kFloat64,
              "tone curve: expected two numbers, not ", values.sizes());
  const auto v = values.accessor<double, 1>();
  TORCH_CHECK(v[0] > 0.0 && v[1] >= 0.0, "tone curve: gamma ", v[0], ", offset ", v[1]);
  return {.gamma = v[0], .offset = v[1]};
}

Gaussians with_encoded_colors(const Gaussians& gaussians, const ToneCurve& curve) {
  if (curve.is_linear()) return gaussians;
  const Tensor light = sh_dc_to_color(gaussians.sh_dc);
  return recolored(gaussians, encoded(curve, light), curve.slope(light));
}

Gaussians with_decoded_colors(const Gaussians& gaussians, const ToneCurve& curve) {
  if (curve.is_linear()) return gaussians;
  const Tensor light = curve.decode(sh_dc_to_color(gaussians.sh_dc));
  return recolored(gaussians, light, curve.slope(light).reciprocal());
}

}  // namespace apvi::gaussians
