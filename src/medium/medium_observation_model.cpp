// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium_observation_model.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace apvi::medium {
namespace {

using torch::Tensor;

constexpr double kMaxDaylight = 0.98;
constexpr double kMinHalfBeam_rad = 0.02;
constexpr double kMaxHalfBeam_rad = 1.54;  // 88 degrees
const auto kF64 = torch::dtype(torch::kFloat64);

enum Own : std::int64_t { kAttenuation, kRatio, kVeilingLight, kDaylight, kLampBackscatter };
enum Shared : std::int64_t { kSquare, kFourth, kHalfBeam, kEdge };

}  // namespace

MediumObservationModel::MediumObservationModel(const Observations& observations,
                                               const MediumPrior& prior)
    : observations_(observations), prior_(prior) {
  layout_.views = observations.view_count;
  if (prior.lamps.empty()) return;
  layout_.own = kLampBackscatter + 1;
  layout_.shared = kEdge + 1;
  const Tensor& places = observations.places;
  unit_range_m_ = distance_from_lamps(prior.lamps, places).median().item<double>();
  irradiance_ = LampSum::irradiance(prior.lamps, unit_range_m_, places, observations.normals);
  lamp_backscatter_ =
      LampSum::backscatter(prior.lamps, unit_range_m_,
                           places / places.norm(2, 1, true).clamp_min(1e-9), observations.ranges);
}

Tensor MediumObservationModel::mean() const {
  Tensor mean = torch::zeros({layout_.size()}, kF64);
  Tensor own = layout_.by_channel(mean);
  own.select(1, kAttenuation) = prior_.medium.beta_d.to(kF64).log();
  own.select(1, kRatio) = prior_.log_ratio;
  own.select(1, kVeilingLight) = prior_.medium.b_inf.to(kF64).log();
  if (prior_.lamps.empty()) return mean;
  own.select(1, kDaylight) = prior_.daylight;
  own.select(1, kLampBackscatter) = std::log(prior_.lamp_backscatter);
  mean[layout_.first_shared() + kEdge] = prior_.lamps.front().edge;
  return mean;
}

Tensor MediumObservationModel::sigma() const {
  Tensor sigma = torch::full({layout_.size()}, prior_.gain_sigma, kF64);
  layout_.by_channel(sigma).copy_(
      torch::tensor({prior_.beta_sigma, prior_.ratio_sigma, prior_.b_inf_sigma,
                     prior_.daylight_sigma, prior_.lamp_backscatter_sigma},
                    kF64)
          .slice(0, 0, layout_.own));
  sigma.slice(0, layout_.first_shared(), layout_.first_gain())
      .copy_(torch::tensor({prior_.vignetting_sigma, prior_.vignetting_sigma,
                            prior_.half_beam_sigma, prior_.edge_sigma},
                           kF64)
                 .slice(0, 0, layout_.shared));
  return sigma;
}

void MediumObservationModel::confine(Tensor& parameters) const {
  const Vignetting valid = vignetting(parameters).confined();
  const std::int64_t shared = layout_.first_shared();
  parameters[shared + kSquare] = valid.square;
  parameters[shared + kFourth] = valid.fourth;
  if (prior_.lamps.empty()) return;
  layout_.by_channel(parameters).select(1, kDaylight).clamp_(0.0, kMaxDaylight);
  parameters[shared + kEdge].clamp_(0.0, 1.0);
}

Vignetting MediumObservationModel::vignetting(const Tensor& parameters) const {
  const std::int64_t shared = layout_.first_shared();
  return {.square = parameters[shared + kSquare].item<double>(),
          .fourth = parameters[shared + kFourth].item<double>()};
}

std::vector<Lamp> MediumObservationModel::lamps(const Tensor& parameters) const {
  const std::int64_t shared = layout_.first_shared();
  std::vector<Lamp> lamps = prior_.lamps;
  for (Lamp& lamp : lamps) {
    const double half =
        lamp.half_beam_rad * std::exp(parameters[shared + kHalfBeam].item<double>());
    lamp.half_beam_rad = std::clamp(half, kMinHalfBeam_rad, kMaxHalfBeam_rad);
    lamp.edge = parameters[shared + kEdge].item<double>();
  }
  return lamps;
}

Tensor MediumObservationModel::responses(const Tensor& parameters) const {
  return parameters.slice(0, layout_.first_gain()).exp().index_select(0, observations_.views) *
         vignetting(parameters).factor(observations_.corners2);
}

std::vector<ChannelModel> MediumObservationModel::evaluate(const Tensor& parameters,
                                                           bool with_derivatives) const {
  const Tensor response = responses(parameters);
  const Tensor own = layout_.by_channel(parameters);
  const Tensor& z = observations_.ranges;
  std::vector<ChannelModel> models;
  for (std::int64_t c = 0; c < 3; ++c) {
    const Tensor beta_d = own[c][kAttenuation].exp();
    const Tensor beta_b = beta_d * own[c][kRatio].exp();
    const Tensor b_inf = own[c][kVeilingLight].exp();
    const Tensor back = torch::exp(-beta_b * z);
    ChannelModel m;
    m.direct = response * torch::exp(-beta_d * z);
    m.backscatter = response * b_inf * (1.0 - back);
    if (with_derivatives) {
      m.direct_derivatives = {-beta_d * z * m.direct, Tensor(), Tensor()};
      const Tensor by_ratio = response * b_inf * beta_b * z * back;
      m.backscatter_derivatives = {by_ratio, by_ratio, m.backscatter};
    }
    models.push_back(std::move(m));
  }
  if (!prior_.lamps.empty()) add_lamps(parameters, response, with_derivatives, models);
  if (with_derivatives) {
    for (ChannelModel& m : models) add_vignetting_derivatives(m);
  }
  return models;
}

// Before those by the beam.
void MediumObservationModel::add_vignetting_derivatives(ChannelModel& m) const {
  const Tensor& s = observations_.corners2;
  const auto add = [&](std::vector<Tensor>& derivatives, const Tensor& light) {
    const Tensor by_square = -s * light;
    derivatives.insert(derivatives.begin() + layout_.own, {by_square, s * by_square});
  };
  add(m.direct_derivatives, m.direct);
  add(m.backscatter_derivatives, m.backscatter);
}

namespace {

/// Light of the lamps in one channel; derivatives if the terms have them.
struct LampChannel {
  Tensor irradiance, backscatter;
  Tensor irradiance_by_beta, backscatter_by_beta;  ///< by the logarithm of beta_d
  std::array<Tensor, 2> irradiance_by_beam, backscatter_by_beam;

  LampChannel(const LampTerm& e, const LampTerm& b, std::int64_t c, const Tensor& beta)
      : irradiance(e.value.select(1, c)), backscatter(b.value.select(1, c)) {
    if (!e.by_beta_d.defined()) return;
    irradiance_by_beta = e.by_beta_d.select(1, c) * beta;
    backscatter_by_beta = b.by_beta_d.select(1, c) * beta;
    irradiance_by_beam = {e.by_half_beam.select(1, c), e.by_edge.select(1, c)};
    backscatter_by_beam = {b.by_half_beam.select(1, c), b.by_edge.select(1, c)};
  }
};

/// Changes the derivatives of a channel without lamps: the direct light is to be multiplied by
/// `light`, and the lamps' backscatter to be added. Those by the beam come last.
void add_lamp_derivatives(const LampChannel& lamp, const Tensor& daylight, const Tensor& light,
                          const Tensor& lamp_gain, ChannelModel& m) {
  const Tensor by_lamp = m.direct * (1.0 - daylight);
  auto& direct = m.direct_derivatives;
  direct[kAttenuation] = direct[kAttenuation] * light + by_lamp * lamp.irradiance_by_beta;
  direct.push_back(m.direct * (1.0 - lamp.irradiance));
  direct.emplace_back();
  auto& scattered = m.backscatter_derivatives;
  scattered[kAttenuation] = scattered[kAttenuation] + lamp_gain * lamp.backscatter_by_beta;
  scattered.emplace_back();
  scattered.push_back(lamp_gain * lamp.backscatter);
  for (std::size_t k = 0; k < lamp.irradiance_by_beam.size(); ++k) {
    direct.push_back(by_lamp * lamp.irradiance_by_beam[k]);
    scattered.push_back(lamp_gain * lamp.backscatter_by_beam[k]);
  }
}

}  // namespace

void MediumObservationModel::add_lamps(const Tensor& parameters, const Tensor& response,
                                       bool with_derivatives,
                                       std::vector<ChannelModel>& models) const {
  const Tensor own = layout_.by_channel(parameters);
  const Tensor betas = own.select(1, kAttenuation).exp();
  const std::vector<Lamp> now = lamps(parameters);
  const LampTerm irradiance = irradiance_->at(betas, now, with_derivatives);
  const LampTerm integral = lamp_backscatter_->at(betas, now, with_derivatives);
  for (std::int64_t c = 0; c < 3; ++c) {
    ChannelModel& m = models[static_cast<std::size_t>(c)];
    const LampChannel lamp(irradiance, integral, c, betas[c]);
    const Tensor daylight = own[c][kDaylight];
    const Tensor lamp_gain = response * own[c][kLampBackscatter].exp();
    const Tensor light = daylight + (1.0 - daylight) * lamp.irradiance;
    if (with_derivatives) add_lamp_derivatives(lamp, daylight, light, lamp_gain, m);
    m.direct = m.direct * light;
    m.backscatter = m.backscatter + lamp_gain * lamp.backscatter;
  }
}

Medium MediumObservationModel::medium(const Tensor& parameters) const {
  const Tensor own = layout_.by_channel(parameters);
  Medium water = {.beta_d = own.select(1, kAttenuation).exp(),
                  .beta_b = (own.select(1, kAttenuation) + own.select(1, kRatio)).exp(),
                  .b_inf = own.select(1, kVeilingLight).exp().clamp(1e-3, 0.98)};
  if (prior_.lamps.empty()) return water;
  water.lamp = LampLight{.lamps = lamps(parameters),
                         .unit_range_m = unit_range_m_,
                         .daylight = own.select(1, kDaylight).clone(),
                         .backscatter = own.select(1, kLampBackscatter).exp()};
  return water;
}

}  // namespace apvi::medium
