// SPDX-License-Identifier: BSD-3-Clause
#include "water_model.hpp"

#include <torch/torch.h>

#include <cmath>

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr double kMostDaylight = 0.98;
constexpr double kFlattest = 0.2;  // cosine of the angle at which a lamp's light still counts
const auto kF64 = torch::dtype(torch::kFloat64);

enum Parameter : std::int64_t { kBeta, kRatio, kVeil, kDaylight, kGlow };

}  // namespace

WaterModel::WaterModel(const Sightings& sightings, const WaterPrior& prior)
    : sightings_(sightings), prior_(prior), lamp_(prior.lamp) {
  if (!lamp_) return;
  const Tensor position = torch::tensor(
      {lamp_->position_m[0], lamp_->position_m[1], lamp_->position_m[2]}, torch::kFloat64);
  const Tensor from = sightings_.places - position;
  unit_range_m_ = from.norm(2, 1).median().item<double>();
  haze_.emplace(*lamp_, unit_range_m_,
                sightings_.places / sightings_.places.norm(2, 1, true).clamp_min(1e-9),
                sightings_.ranges);
  facing_ = ((from * sightings_.normals).sum(1) / from.norm(2, 1).clamp_min(1e-9))
                .abs()
                .clamp_min(kFlattest);
}

Tensor WaterModel::mean(std::int64_t channel) const {
  const auto log_of = [channel](const Tensor& t) {
    return std::log(t[channel].to(torch::kFloat64).item<double>());
  };
  return torch::tensor({log_of(prior_.medium.beta_d), prior_.log_ratio, log_of(prior_.medium.b_inf),
                        prior_.daylight, std::log(prior_.glow)},
                       torch::kFloat64)
      .slice(0, 0, parameters());
}

Tensor WaterModel::sigma() const {
  return torch::tensor({prior_.beta_sigma, prior_.ratio_sigma, prior_.b_inf_sigma,
                        prior_.daylight_sigma, prior_.glow_sigma},
                       torch::kFloat64)
      .slice(0, 0, parameters());
}

void WaterModel::confine(Tensor& parameters) const {
  if (lamp_) parameters.select(1, kDaylight).clamp_(0.0, kMostDaylight);
}

std::vector<ChannelModel> WaterModel::evaluate(const Tensor& parameters,
                                               const Tensor& responses) const {
  std::vector<ChannelModel> models;
  for (std::int64_t c = 0; c < 3; ++c) {
    const Tensor beta_d = parameters[c][kBeta].exp();
    const Tensor beta_b = beta_d * parameters[c][kRatio].exp();
    const Tensor b_inf = parameters[c][kVeil].exp();
    const Tensor back = torch::exp(-beta_b * sightings_.ranges);
    ChannelModel m;
    m.through = responses * torch::exp(-beta_d * sightings_.ranges);
    m.veil = responses * b_inf * (1.0 - back);
    m.through_by = {-beta_d * sightings_.ranges * m.through, Tensor(), Tensor()};
    const Tensor by_ratio = responses * b_inf * beta_b * sightings_.ranges * back;
    m.veil_by = {by_ratio, by_ratio, m.veil};
    models.push_back(std::move(m));
  }
  if (lamp_) add_lamp(parameters, responses, models);
  return models;
}

void WaterModel::add_lamp(const Tensor& parameters, const Tensor& responses,
                          std::vector<ChannelModel>& models) const {
  const Tensor betas = parameters.select(1, kBeta).exp();
  const auto shine = splat::lamp_shine(*lamp_, unit_range_m_, betas, sightings_.places);
  const auto haze = haze_->at(betas);
  for (std::int64_t c = 0; c < 3; ++c) {
    ChannelModel& m = models[static_cast<std::size_t>(c)];
    const Tensor daylight = parameters[c][kDaylight];
    const Tensor glow = responses * parameters[c][kGlow].exp();
    const Tensor lamp = facing_ * shine.value.select(1, c);
    const Tensor light = daylight + (1.0 - daylight) * lamp;
    const Tensor light_by_beta =
        (1.0 - daylight) * facing_ * shine.by_beta_d.select(1, c) * betas[c];
    m.through_by[kBeta] = m.through_by[kBeta] * light + m.through * light_by_beta;
    m.through_by.push_back(m.through * (1.0 - lamp));
    m.through_by.emplace_back();
    m.through = m.through * light;
    const Tensor veil = glow * haze.value.select(1, c);
    m.veil_by[kBeta] = m.veil_by[kBeta] + glow * haze.by_beta_d.select(1, c) * betas[c];
    m.veil_by.emplace_back();
    m.veil_by.push_back(veil);
    m.veil = m.veil + veil;
  }
}

splat::Medium WaterModel::medium(const Tensor& parameters) const {
  const auto log_of = [&parameters](Parameter p) { return parameters.select(1, p); };
  splat::Medium water = {.beta_d = log_of(kBeta).exp(),
                         .beta_b = (log_of(kBeta) + log_of(kRatio)).exp(),
                         .b_inf = log_of(kVeil).exp().clamp(1e-3, 0.98)};
  if (!lamp_) return water;
  water.lamp = splat::LampLight{.lamp = *lamp_,
                                .unit_range_m = unit_range_m_,
                                .daylight = log_of(kDaylight).clone(),
                                .glow = log_of(kGlow).exp()};
  return water;
}

}  // namespace apvi::mapping
