// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "medium/medium_fit.hpp"

namespace apvi::medium {

/// Predicted observations of one channel, direct * color + backscatter, with derivatives of both
/// with respect to the channel's parameters; all [n].
struct ChannelModel {
  torch::Tensor direct;
  torch::Tensor backscatter;
  std::vector<torch::Tensor> direct_derivatives;  ///< by parameter; undefined: zero
  std::vector<torch::Tensor> backscatter_derivatives;
};

/// Eq. (8) of the paper for observations, optionally with a lamp (LampLight). Parameters of a
/// channel: log(beta_d), log(beta_b / beta_d), log(b_inf); with a lamp also the daylight and the
/// logarithm of the lamp's backscatter.
class MediumObservationModel {
 public:
  /// `observations` must outlive the model.
  MediumObservationModel(const Observations& observations, const MediumPrior& prior);

  std::int64_t parameters() const { return lamps_.empty() ? 3 : 5; }
  /// Prior means and standard deviations [parameters()].
  torch::Tensor mean(std::int64_t channel) const;
  torch::Tensor sigma() const;
  /// Clamps parameters [3,parameters()] to their valid range.
  void confine(torch::Tensor& parameters) const;

  /// Model of each channel for camera responses (gain times vignetting) `responses` [n].
  std::vector<ChannelModel> evaluate(const torch::Tensor& parameters,
                                     const torch::Tensor& responses) const;
  /// The medium of parameters [3,parameters()].
  Medium medium(const torch::Tensor& parameters) const;

 private:
  void add_lamp(const torch::Tensor& parameters, const torch::Tensor& responses,
                std::vector<ChannelModel>& models) const;

  const Observations& observations_;
  MediumPrior prior_;
  std::vector<Lamp> lamps_;
  double unit_range_m_ = 1.0;
  std::optional<LampBackscatterIntegral> lamp_integral_;
};

}  // namespace apvi::medium
