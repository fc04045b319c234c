// SPDX-License-Identifier: BSD-3-Clause
#include "medium/medium_observation_model.hpp"

#include <torch/torch.h>

#include <cmath>

namespace apvi::medium {
namespace {

using torch::Tensor;

constexpr double kMaxDaylight = 0.98;
const auto kF64 = torch::dtype(torch::kFloat64);

enum Parameter : std::int64_t { kAttenuation, kRatio, kVeilingLight, kDaylight, kLampBackscatter };

}  // namespace

MediumObservationModel::MediumObservationModel(const Observations& observations,
                                               const MediumPrior& prior)
    : observations_(observations), prior_(prior), lamps_(prior.lamps) {
  if (lamps_.empty()) return;
  unit_range_m_ = distance_from_lamps(lamps_, observations_.places).median().item<double>();
  lamp_integral_.emplace(
      lamps_, unit_range_m_,
      observations_.places / observations_.places.norm(2, 1, true).clamp_min(1e-9),
      observations_.ranges);
}

Tensor MediumObservationModel::mean(std::int64_t channel) const {
  const auto log_of = [channel](const Tensor& t) {
    return std::log(t[channel].to(torch::kFloat64).item<double>());
  };
  return torch::tensor({log_of(prior_.medium.beta_d), prior_.log_ratio, log_of(prior_.medium.b_inf),
                        prior_.daylight, std::log(prior_.lamp_backscatter)},
                       torch::kFloat64)
      .slice(0, 0, parameters());
}

Tensor MediumObservationModel::sigma() const {
  return torch::tensor({prior_.beta_sigma, prior_.ratio_sigma, prior_.b_inf_sigma,
                        prior_.daylight_sigma, prior_.lamp_backscatter_sigma},
                       torch::kFloat64)
      .slice(0, 0, parameters());
}

void MediumObservationModel::confine(Tensor& parameters) const {
  if (!lamps_.empty()) parameters.select(1, kDaylight).clamp_(0.0, kMaxDaylight);
}

std::vector<ChannelModel> MediumObservationModel::evaluate(const Tensor& parameters,
                                                           const Tensor& responses) const {
  std::vector<ChannelModel> models;
  for (std::int64_t c = 0; c < 3; ++c) {
    const Tensor beta_d = parameters[c][kAttenuation].exp();
    const Tensor beta_b = beta_d * parameters[c][kRatio].exp();
    const Tensor b_inf = parameters[c][kVeilingLight].exp();
    const Tensor back = torch::exp(-beta_b * observations_.ranges);
    ChannelModel m;
    m.direct = responses * torch::exp(-beta_d * observations_.ranges);
    m.backscatter = responses * b_inf * (1.0 - back);
    m.direct_derivatives = {-beta_d * observations_.ranges * m.direct, Tensor(), Tensor()};
    const Tensor by_ratio = responses * b_inf * beta_b * observations_.ranges * back;
    m.backscatter_derivatives = {by_ratio, by_ratio, m.backscatter};
    models.push_back(std::move(m));
  }
  if (!lamps_.empty()) add_lamp(parameters, responses, models);
  return models;
}

void MediumObservationModel::add_lamp(const Tensor& parameters, const Tensor& responses,
                                      std::vector<ChannelModel>& models) const {
  const Tensor betas = parameters.select(1, kAttenuation).exp();
  const auto irradiance =
      lamp_irradiance(lamps_, unit_range_m_, betas, observations_.places, observations_.normals);
  const auto integral = lamp_integral_->at(betas);
  for (std::int64_t c = 0; c < 3; ++c) {
    ChannelModel& m = models[static_cast<std::size_t>(c)];
    const Tensor daylight = parameters[c][kDaylight];
    const Tensor lamp_gain = responses * parameters[c][kLampBackscatter].exp();
    const Tensor lamp = irradiance.value.select(1, c);
    const Tensor light = daylight + (1.0 - daylight) * lamp;
    const Tensor light_by_beta = (1.0 - daylight) * irradiance.derivative.select(1, c) * betas[c];
    m.direct_derivatives[kAttenuation] =
        m.direct_derivatives[kAttenuation] * light + m.direct * light_by_beta;
    m.direct_derivatives.push_back(m.direct * (1.0 - lamp));
    m.direct_derivatives.emplace_back();
    m.direct = m.direct * light;
    const Tensor backscatter = lamp_gain * integral.value.select(1, c);
    m.backscatter_derivatives[kAttenuation] =
        m.backscatter_derivatives[kAttenuation] +
        lamp_gain * integral.derivative.select(1, c) * betas[c];
    m.backscatter_derivatives.emplace_back();
    m.backscatter_derivatives.push_back(backscatter);
    m.backscatter = m.backscatter + backscatter;
  }
}

Medium MediumObservationModel::medium(const Tensor& parameters) const {
  const auto log_of = [&parameters](Parameter p) { return parameters.select(1, p); };
  Medium water = {.beta_d = log_of(kAttenuation).exp(),
                  .beta_b = (log_of(kAttenuation) + log_of(kRatio)).exp(),
                  .b_inf = log_of(kVeilingLight).exp().clamp(1e-3, 0.98)};
  if (lamps_.empty()) return water;
  water.lamp = LampLight{.lamps = lamps_,
                         .unit_range_m = unit_range_m_,
                         .daylight = log_of(kDaylight).clone(),
                         .backscatter = log_of(kLampBackscatter).exp()};
  return water;
}

}  // namespace apvi::medium
