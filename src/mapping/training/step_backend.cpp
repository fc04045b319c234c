// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/training/step_backend.hpp"

#include <torch/torch.h>

#include "mapping/keyframes/keyframe_store.hpp"
#include "mapping/medium/open_water.hpp"
#include "mapping/training/step_constants.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

/// Second differences [...,2,H-2r,W-2r] of [...,H,W], vertical and horizontal, r = kCurvatureReach.
/// Slices are faster than a convolution with few distant taps.
Tensor second_differences(const Tensor& image) {
  constexpr std::int64_t kReach = step::kCurvatureReach;
  const auto part = [&image](std::int64_t down, std::int64_t across) {
    return image.narrow(-2, down, image.size(-2) - 2 * kReach)
        .narrow(-1, across, image.size(-1) - 2 * kReach);
  };
  const Tensor twice = 2.0 * part(kReach, kReach);
  return torch::stack({part(0, kReach) + part(2 * kReach, kReach) - twice,
                       part(kReach, 0) + part(kReach, 2 * kReach) - twice},
                      -3);
}

/// Where colors [3,H,W] differ from `water` [3,H,W].
Tensor differs_from_water(const Tensor& colors, const Tensor& water) {
  const Tensor tolerance = step::kOpenWaterAbsTolerance + step::kOpenWaterRelTolerance * water;
  return ((colors - water).abs() >= tolerance).any(0);
}

/// Where an image [H,W,3] shows `water`: its hue, by at least two unsaturated channels, and a
/// brightness near `log_gain`.
Tensor is_open_water(const Tensor& image, const Tensor& water, const Tensor& log_gain) {
  const auto [mean, uniform] = local_uniformity(image);
  const Tensor unsaturated = mean < step::kSaturated;
  const Tensor expected = unsaturated * water.permute({2, 0, 1});
  const Tensor observed = unsaturated * mean;
  const Tensor factor = observed.sum(0) / expected.sum(0).clamp_min(step::kMinDivisor);
  const Tensor log_gain_error = (factor.clamp_min(step::kMinGain).log() - log_gain).abs();
  return uniform & (unsaturated.sum(0) >= 2) &
         differs_from_water(observed, factor * expected).logical_not() &
         (log_gain_error < step::kMaxOpenWaterLogGainError);
}

}  // namespace

Tensor StepBackend::target(const TargetInput& in) const {
  Tensor target = to_float_image(in.image, in.reduction, in.light);
  if (in.falloff.defined()) target = target / in.falloff;
  if (in.log_gain.defined()) target = target / in.log_gain.exp();
  return target;
}

Tensor StepBackend::saturated(const Tensor& image, int reduction) const {
  const torch::NoGradGuard no_grad;
  return target({.image = image, .reduction = reduction, .falloff = {}, .log_gain = {}}) >=
         step::kSaturated;
}

void StepBackend::match_gain(const GainInput& in) const {
  const torch::NoGradGuard no_grad;
  const Tensor solid = in.alpha > step::kSolid;
  const Tensor sky =
      above_horizon(in.horizon, in.alpha.size(0), in.alpha.size(1), in.alpha.device());
  const Tensor open = in.water.defined() ? (solid.logical_not() | sky) &
                                               is_open_water(in.image, in.water, in.log_gain)
                                         : torch::zeros_like(solid);
  const Tensor open_weight = torch::where(sky, step::kSkyWeight, step::kOpenWaterWeight);
  const Tensor pixel_weight =
      (solid | open).to(in.log_gain.options()) * torch::where(open, open_weight, 1.0);
  const Tensor weight = pixel_weight.unsqueeze(2) * (in.image < step::kSaturated);
  const Tensor reference =
      in.water.defined() ? torch::where(open.unsqueeze(2), in.water, in.drawn) : in.drawn;
  const Tensor light = (weight * reference).sum();
  const Tensor measured = ((weight * in.image).sum() / light.clamp_min(step::kMinDivisor))
                              .clamp_min(step::kMinGain)
                              .log();
  const Tensor colors = weight.sum();
  const Tensor usable =
      (colors > step::kMinComparedFraction * static_cast<double>(weight.numel())) &
      (light > step::kMinMeanLight * colors);
  Tensor log_gain = in.log_gain;
  Tensor bias = in.bias;
  const Tensor error = measured - log_gain - bias;
  const Tensor change =
      in.update.step_size * error.clamp(-in.update.max_change, in.update.max_change) -
      in.update.decay * log_gain;
  log_gain.add_(torch::where(usable, change, torch::zeros_like(change)));
  const Tensor bias_change =
      in.update.bias_rate * error.clamp(-step::kMaxLogGainBiasError, step::kMaxLogGainBiasError);
  bias.add_(torch::where(usable, bias_change, torch::zeros_like(bias_change)));
}

Tensor StepBackend::classify_water(const Tensor& image, const Tensor& water) const {
  const torch::NoGradGuard no_grad;
  const auto [mean, uniform] = local_uniformity(image);
  const Tensor expected = water.permute({2, 0, 1});
  const Tensor differs = differs_from_water(mean, expected);
  const Tensor open = uniform & differs.logical_not();
  const Tensor surface = differs & differs_from_water(image.permute({2, 0, 1}), expected);
  return open.to(torch::kInt8) - surface.to(torch::kInt8);
}

Tensor StepBackend::opacity_loss_gradient(const Tensor& image, const Tensor& water,
                                          const Tensor& alpha,
                                          const OpacityWeights& weights) const {
  const torch::NoGradGuard no_grad;
  const Tensor kinds = classify_water(image, water);
  const Tensor open = kinds == 1;
  const Tensor near_open =
      torch::max_pool2d(open.to(alpha.scalar_type()).unsqueeze(0), 2 * step::kOpenWaterMargin + 1,
                        1, step::kOpenWaterMargin)
          .squeeze(0);
  const Tensor surface = weights.surface * (alpha - 1.0) * (kinds == -1);
  const Tensor gradient = torch::where(near_open > 0.0, weights.edge, surface);
  return torch::where(open, weights.open, gradient).div_(static_cast<double>(alpha.numel()));
}

void StepBackend::observe(const gaussians::RenderStatistics& statistics,
                          const DensitySums& sums) const {
  const torch::NoGradGuard no_grad;
  const Tensor visible = statistics.visible.to(torch::kFloat32);
  Tensor(sums.gradient).addcmul_(statistics.mean2d_gradient.to(torch::kFloat32), visible);
  Tensor(sums.views).add_(visible);
  Tensor max_weight = sums.max_weight;
  torch::maximum_out(max_weight, max_weight, statistics.max_weight.to(torch::kFloat32));
}

Tensor StepBackend::depth_curvature_loss(const Tensor& depth, const Tensor& alpha,
                                         const Tensor& image) const {
  Tensor solid, even, scale;
  {
    const torch::NoGradGuard no_grad;
    solid = ((alpha > step::kSolid) & (depth > 0.0)).to(depth.scalar_type());
    scale = solid.sum() /
            (solid / depth.clamp_min(step::kCurvatureMinDepth)).sum().clamp_min(step::kMinDivisor);
    const Tensor change = second_differences(torch::stack({image.mean(2), solid})).abs();
    even = torch::exp(change[0] / -step::kCurvatureEdge - change[1] / step::kCurvatureGap);
  }
  const Tensor inverse = solid / depth.clamp_min(step::kCurvatureMinDepth);
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
