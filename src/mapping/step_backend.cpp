// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/step_backend.hpp"

#include <torch/torch.h>

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/open_water.hpp"
#include "apvi/mapping/step_constants.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

/// Second differences [...,2,H-2r,W-2r] of [...,H,W], down and across, r = kBendReach. By slices: a
/// convolution with so few taps so far apart is slow.
Tensor second_differences(const Tensor& image) {
  constexpr std::int64_t kReach = step::kBendReach;
  const auto part = [&image](std::int64_t down, std::int64_t across) {
    return image.narrow(-2, down, image.size(-2) - 2 * kReach)
        .narrow(-1, across, image.size(-1) - 2 * kReach);
  };
  const Tensor twice = 2.0 * part(kReach, kReach);
  return torch::stack({part(0, kReach) + part(2 * kReach, kReach) - twice,
                       part(kReach, 0) + part(kReach, 2 * kReach) - twice},
                      -3);
}

/// Where colours [3,H,W] are not `veil`'s [3,H,W].
Tensor is_off(const Tensor& colors, const Tensor& veil) {
  const Tensor tolerance = step::kOpenOffset + step::kOpenRelative * veil;
  return ((colors - veil).abs() >= tolerance).any(0);
}

/// Where a picture [H,W,3] shows `water`, of its hue and nearly as bright as `log_gain` makes it,
/// by the colours that are not saturated, of which two make a hue.
Tensor open_at_gain(const Tensor& picture, const Tensor& water, const Tensor& log_gain) {
  const auto [mean, even] = evenness(picture);
  const Tensor tells = mean < step::kSaturated;
  const Tensor veil = tells * water.permute({2, 0, 1});
  const Tensor shown = tells * mean;
  const Tensor factor = shown.sum(0) / veil.sum(0).clamp_min(step::kLeastDivisor);
  const Tensor brighter = (factor.clamp_min(step::kLeastGain).log() - log_gain).abs();
  return even & (tells.sum(0) >= 2) & is_off(shown, factor * veil).logical_not() &
         (brighter < step::kOpenGain);
}

}  // namespace

Tensor StepBackend::target(const TargetInput& in) const {
  Tensor target = to_numbers(in.picture, in.reduction);
  if (in.falloff.defined()) target = target / in.falloff;
  if (in.log_gain.defined()) target = target / in.log_gain.exp();
  return target;
}

Tensor StepBackend::saturated(const Tensor& picture, int reduction) const {
  const torch::NoGradGuard no_grad;
  return target({.picture = picture, .reduction = reduction, .falloff = {}, .log_gain = {}}) >=
         step::kSaturated;
}

void StepBackend::match_gain(const GainInput& in) const {
  const torch::NoGradGuard no_grad;
  const Tensor solid = in.alpha > step::kSolid;
  const Tensor sky = above(in.horizon, in.alpha.size(0), in.alpha.size(1), in.alpha.device());
  const Tensor open = in.water.defined() ? (solid.logical_not() | sky) &
                                               open_at_gain(in.picture, in.water, in.log_gain)
                                         : torch::zeros_like(solid);
  const Tensor open_say = torch::where(sky, step::kSkySay, step::kOpenSay);
  const Tensor counts =
      (solid | open).to(in.log_gain.options()) * torch::where(open, open_say, 1.0);
  const Tensor weight = counts.unsqueeze(2) * (in.picture < step::kSaturated);
  const Tensor shown =
      in.water.defined() ? torch::where(open.unsqueeze(2), in.water, in.drawn) : in.drawn;
  const Tensor light = (weight * shown).sum();
  const Tensor wanted = ((weight * in.picture).sum() / light.clamp_min(step::kLeastDivisor))
                            .clamp_min(step::kLeastGain)
                            .log();
  const Tensor colors = weight.sum();
  const Tensor usable = (colors > step::kLeastShare * static_cast<double>(weight.numel())) &
                        (light > step::kLeastLight * colors);
  Tensor own = in.log_gain;
  Tensor usual = in.usual;
  const Tensor off = wanted - own - usual;
  const Tensor change =
      in.pace.share * off.clamp(-in.pace.most, in.pace.most) - in.pace.forgets * own;
  own.add_(torch::where(usable, change, torch::zeros_like(change)));
  const Tensor learned = in.pace.learns * off.clamp(-step::kUsualGain, step::kUsualGain);
  usual.add_(torch::where(usable, learned, torch::zeros_like(learned)));
}

Tensor StepBackend::water_kinds(const Tensor& picture, const Tensor& water) const {
  const torch::NoGradGuard no_grad;
  const auto [mean, even] = evenness(picture);
  const Tensor veil = water.permute({2, 0, 1});
  const Tensor off = is_off(mean, veil);
  const Tensor open = even & off.logical_not();
  const Tensor surface = off & is_off(picture.permute({2, 0, 1}), veil);
  return open.to(torch::kInt8) - surface.to(torch::kInt8);
}

Tensor StepBackend::opacity_pull(const Tensor& picture, const Tensor& water, const Tensor& alpha,
                                 const OpacityWeights& weights) const {
  const torch::NoGradGuard no_grad;
  const Tensor kinds = water_kinds(picture, water);
  const Tensor open = kinds == 1;
  const Tensor near_open = torch::max_pool2d(open.to(alpha.scalar_type()).unsqueeze(0),
                                             2 * step::kBesideOpen + 1, 1, step::kBesideOpen)
                               .squeeze(0);
  const Tensor closing = weights.surface * (alpha - 1.0) * (kinds == -1);
  const Tensor pull = torch::where(near_open > 0.0, weights.edge, closing);
  return torch::where(open, weights.open, pull).div_(static_cast<double>(alpha.numel()));
}

void StepBackend::observe(const splat::RenderStatistics& statistics, const SeenSums& sums) const {
  const torch::NoGradGuard no_grad;
  const Tensor visible = statistics.visible.to(torch::kFloat32);
  Tensor(sums.gradient).addcmul_(statistics.mean2d_gradient.to(torch::kFloat32), visible);
  Tensor(sums.views).add_(visible);
  Tensor most = sums.max_weight;
  torch::maximum_out(most, most, statistics.max_weight.to(torch::kFloat32));
}

Tensor StepBackend::bentness(const Tensor& depth, const Tensor& alpha,
                             const Tensor& picture) const {
  Tensor solid, even, scale;
  {
    const torch::NoGradGuard no_grad;
    solid = ((alpha > step::kSolid) & (depth > 0.0)).to(depth.scalar_type());
    scale = solid.sum() /
            (solid / depth.clamp_min(step::kBendNearest)).sum().clamp_min(step::kLeastDivisor);
    const Tensor change = second_differences(torch::stack({picture.mean(2), solid})).abs();
    even = torch::exp(change[0] / -step::kBendEdge - change[1] / step::kBendGap);
  }
  const Tensor inverse = solid / depth.clamp_min(step::kBendNearest);
  return scale * (even * second_differences(inverse).abs()).mean();
}

#if APVI_WITH_CUDA
const StepBackend& step_backend(const torch::Device& device) {
  static const StepBackend operators;
  return device.is_cuda() ? cuda_step_backend() : operators;
}
#else
const StepBackend& step_backend(const torch::Device& /*device*/) {
  static const StepBackend operators;
  return operators;
}
#endif

}  // namespace apvi::mapping
