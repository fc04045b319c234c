// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "medium/medium_fit.hpp"

namespace apvi::medium {

/// Where the parameters of a fit are in its vector: those of each channel, those that the channels
/// share (vignetting, then the beam of the lamps), the logarithms of the views' gains.
struct MediumFitLayout {
  std::int64_t own = 3;  ///< of a channel
  std::int64_t shared = 2;
  std::int64_t views = 0;

  std::int64_t first_shared() const { return 3 * own; }
  std::int64_t first_gain() const { return first_shared() + shared; }
  std::int64_t size() const { return first_gain() + views; }
  /// A view [3,own] of the channels' parameters.
  torch::Tensor by_channel(const torch::Tensor& parameters) const {
    return parameters.slice(0, 0, first_shared()).view({3, own});
  }
};

/// Predicted observations of one channel, direct * color + backscatter; all [n].
struct ChannelModel {
  torch::Tensor direct;
  torch::Tensor backscatter;
  /// Of both, by the channel's own and then by the shared parameters; undefined: zero.
  std::vector<torch::Tensor> direct_derivatives;
  std::vector<torch::Tensor> backscatter_derivatives;
};

/// Eq. (8) of the paper for observations, optionally with lamps (LampLight). Parameters of a
/// channel: log(beta_d), log(beta_b / beta_d), log(b_inf); with lamps also the daylight and the
/// logarithm of their backscatter. Shared: the vignetting; with lamps also the logarithm of their
/// half beam angle relative to the prior's, and their edge. All vectors of parameters are float64
/// [layout().size()].
class MediumObservationModel {
 public:
  /// `observations` must outlive the model.
  MediumObservationModel(const Observations& observations, const MediumPrior& prior);

  const MediumFitLayout& layout() const { return layout_; }
  /// Prior means and standard deviations.
  torch::Tensor mean() const;
  torch::Tensor sigma() const;
  /// Clamps parameters to their valid range.
  void confine(torch::Tensor& parameters) const;

  /// Model of each channel.
  std::vector<ChannelModel> evaluate(const torch::Tensor& parameters, bool with_derivatives) const;

  Medium medium(const torch::Tensor& parameters) const;
  Vignetting vignetting(const torch::Tensor& parameters) const;

 private:
  std::vector<Lamp> lamps(const torch::Tensor& parameters) const;
  torch::Tensor responses(const torch::Tensor& parameters) const;
  void add_vignetting_derivatives(ChannelModel& model) const;
  void add_lamps(const torch::Tensor& parameters, const torch::Tensor& response,
                 bool with_derivatives, std::vector<ChannelModel>& models) const;

  const Observations& observations_;
  MediumPrior prior_;
  MediumFitLayout layout_;
  double unit_range_m_ = 1.0;
  std::optional<LampSum> irradiance_;
  std::optional<LampSum> lamp_backscatter_;
};

}  // namespace apvi::medium
