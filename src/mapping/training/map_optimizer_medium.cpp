// SPDX-License-Identifier: BSD-3-Clause
// The medium and the camera's response of a MapOptimizer.
#include <fmt/format.h>
#include <torch/torch.h>

#include <cmath>

#include "apvi/core/log.hpp"
#include "gaussians/device.hpp"
#include "mapping/appearance/recolor.hpp"
#include "mapping/training/map_optimizer.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kMinVeilingLight = 1e-3;
constexpr double kMaxVeilingLight = 0.98;

medium::Medium on_device(const medium::Medium& medium) {
  const auto copy = [](const Tensor& values) {
    return values.detach().to(gaussians::active_device(), torch::kFloat32);
  };
  return {.beta_d = copy(medium.beta_d),
          .beta_b = copy(medium.beta_b),
          .b_inf = copy(medium.b_inf),
          .lamp = medium.lamp};
}

std::vector<double> seconds_of(const KeyframeStore& keyframes) {
  std::vector<double> seconds(keyframes.size());
  for (std::size_t i = 0; i < seconds.size(); ++i) {
    seconds[i] = 1e-9 * static_cast<double>(keyframes[i].stamp_ns - keyframes[0].stamp_ns);
  }
  return seconds;
}

double median_of(const Tensor& values, const std::vector<std::size_t>& among) {
  const std::vector<std::int64_t> rows(among.begin(), among.end());
  return values.index_select(0, torch::tensor(rows, torch::kInt64)).median().item<double>();
}

}  // namespace

void MapOptimizer::create_medium(const medium::Medium& medium) {
  medium_.emplace(on_device(medium));
  medium_->set_vio_failing(vio_failing_);
}

void MapOptimizer::recolor_for(const Map& after, const KeyframeStore& keyframes) {
  if (shared_->has_sessions) return;
  // Of a part of the map, only the views there say something.
  const bool is_part = shared_->detached > 0;
  recolor(full_map(), after, keyframes,
          is_part ? anchor_views(shared_->store.anchors(), keyframes) : keyframes.training());
  ++shared_->appearance_version;
}

void MapOptimizer::start_medium(const medium::Medium& medium, const KeyframeStore& keyframes) {
  const torch::NoGradGuard no_grad;
  Map after = full_map();
  after.medium = on_device(medium);
  recolor_for(after, keyframes);
  create_medium(*after.medium);
  medium_views_.clear();
}

void MapOptimizer::hold_medium() {
  if (medium_) medium_->set_prior(*medium(), torch::zeros({3, 3, 3}));
}

void MapOptimizer::start_from(const CameraResponse& response) {
  const torch::NoGradGuard no_grad;
  vignetting_ = response.vignetting;
  falloffs_.clear();
  if (response.log_gains.defined()) gains_.set_logs(response.log_gains);
  if (illumination_ && response.illumination.defined())
    illumination_->set_logs(response.illumination);
}

void MapOptimizer::apply_medium(const MediumEstimation& estimation,
                                const KeyframeStore& keyframes) {
  const torch::NoGradGuard no_grad;
  medium_posterior_ = estimation.fit.posterior;
  tone_curve_evidence_ = estimation.evidence;
  if (estimation.saved_deviance) {
    medium_support_.add(*estimation.saved_deviance, estimation.observations);
    log::debug("the medium lowers the deviance of {} observations by {:.0f}",
               estimation.observations, *estimation.saved_deviance);
    if (!medium_support_.is_sufficient()) return remove_medium(keyframes);
  }
  if (!(estimation.tone_curve == tone_curve_)) {
    const bool is_linear = estimation.tone_curve == gaussians::ToneCurve{};
    log::info("the camera's response to light looks {}",
              is_linear ? "linear"
                        : fmt::format("like a power: value = light^(1/{:.2g})",
                                      1.0 / estimation.tone_curve.exponent()));
  }
  Map after = with_curve(estimation.tone_curve);
  medium::Medium water = estimation.fit.medium;
  if (options_.gain_compensation) {
    const Tensor logs =
        interpolate_gains(after.log_gains.to(torch::kCPU, torch::kFloat64), seconds_of(keyframes),
                          estimation.views, estimation.fit.log_gains);
    const double median = median_of(logs, keyframes.training());
    after.log_gains = (logs - median).to(gains_.logs().options());
    water.b_inf = water.b_inf * std::exp(median);
    if (water.lamp) water.lamp->backscatter = water.lamp->backscatter * std::exp(median);
  }
  water.b_inf = medium_posterior_
                    .add_veiling_light(water.b_inf.log(), estimation.fit.sigmas.select(1, 2),
                                       estimation.sees_open_water)
                    .exp()
                    .clamp(kMinVeilingLight, kMaxVeilingLight);
  after.vignetting = estimation.fit.vignetting;
  after.medium = water;
  apply_appearance(after, estimation.fit.resolution, keyframes);
}

void MapOptimizer::remove_medium(const KeyframeStore& keyframes) {
  if (!medium_) return;
  log::info("the images do not show that there is water: the map has no medium");
  Map after = with_curve(tone_curve_evidence_.initial());
  after.medium.reset();
  apply_appearance(after, {}, keyframes);
}

Map MapOptimizer::with_curve(const gaussians::ToneCurve& curve) const {
  // Logarithms of light per logarithm of light by the previous curve.
  const double contrast = tone_curve_.exponent() / curve.exponent();
  Map changed = full_map();
  if (changed.log_gains.defined()) changed.log_gains = changed.log_gains * contrast;
  changed.tone_curve = curve;
  return changed;
}

void MapOptimizer::apply_appearance(const Map& after, const Tensor& resolution,
                                    const KeyframeStore& keyframes) {
  recolor_for(after, keyframes);
  if (options_.gain_compensation) gains_.set_logs(after.log_gains);
  vignetting_ = after.vignetting;
  falloffs_.clear();
  set_tone_curve(after.tone_curve);
  medium_views_.clear();
  if (!after.medium) return medium_.reset();
  if (!medium_) create_medium(*after.medium);
  medium_->set_prior(*after.medium, resolution);
}

void MapOptimizer::set_tone_curve(const gaussians::ToneCurve& curve) {
  tone_curve_ = curve;
  light_table_ = Tensor();
}

}  // namespace apvi::mapping
