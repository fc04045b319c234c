// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "apvi/mapping/water_fit.hpp"

namespace apvi::mapping {

/// How sightings look in one channel: through * colour + veil, with derivatives of both by the
/// channel's parameters; all [n].
struct ChannelModel {
  torch::Tensor through;
  torch::Tensor veil;
  std::vector<torch::Tensor> through_by;  ///< one a parameter; undefined: none
  std::vector<torch::Tensor> veil_by;
};

/// Eq. (8) for sightings, with the light of a lamp if there is one (splat::LampLight). Parameters
/// of a channel: logarithms of beta_d, beta_b / beta_d and b_inf; with a lamp besides, the daylight
/// and the logarithm of the glow.
class WaterModel {
 public:
  /// `sightings` must outlive the model.
  WaterModel(const Sightings& sightings, const WaterPrior& prior);

  std::int64_t parameters() const { return lamp_ ? 5 : 3; }
  /// Means and sigmas [parameters()] of what is believed before.
  torch::Tensor mean(std::int64_t channel) const;
  torch::Tensor sigma() const;
  /// Parameters [3,parameters()] moved back into their range.
  void confine(torch::Tensor& parameters) const;

  /// Of all channels, seen by a camera of these `responses` [n].
  std::vector<ChannelModel> evaluate(const torch::Tensor& parameters,
                                     const torch::Tensor& responses) const;
  /// The water of parameters [3,parameters()].
  splat::Medium medium(const torch::Tensor& parameters) const;

 private:
  void add_lamp(const torch::Tensor& parameters, const torch::Tensor& responses,
                std::vector<ChannelModel>& models) const;

  const Sightings& sightings_;
  WaterPrior prior_;
  std::optional<splat::Lamp> lamp_;
  double unit_range_m_ = 1.0;
  std::optional<splat::LampHaze> haze_;
  torch::Tensor facing_;  ///< [n] cosine of the angle between the lamp's light and the normal
};

}  // namespace apvi::mapping
