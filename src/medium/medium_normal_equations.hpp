// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>
#include <vector>

#include "medium/medium_fit.hpp"
#include "medium/medium_observation_model.hpp"

namespace apvi::medium {

/// The same observations, sorted by point and then by view.
Observations sorted_by_point(const Observations& observations);

/// Robust normal equations of the observations with the points' colors eliminated (variable
/// projection). Each point involves few parameters, so sums only run over the affected columns.
class MediumNormalEquations {
 public:
  /// `observations` must be sorted by `sorted_by_point` and outlive this.
  MediumNormalEquations(const Observations& observations, const MediumFitLayout& layout);

  /// Sets noise and weights by the residuals of the models of all channels. Noise is at least
  /// `min_noise` (image values), so that a large one makes the weights less robust.
  void reweight(const std::vector<ChannelModel>& models, double min_noise);
  /// Robust sum of squared residuals with this noise.
  double cost(const std::vector<ChannelModel>& models) const;
  /// Adds to the information matrix A [m,m] and the gradient b [m] of half the weighted sum of
  /// squares, float64.
  void add(const std::vector<ChannelModel>& models, torch::Tensor& A, torch::Tensor& b) const;

  /// Noise of an observation in image values, by channel.
  const std::array<double, 3>& noise() const { return noise_; }
  /// Minus twice the logarithm of the likelihood of the last residuals as image values, up to a
  /// constant; observations are downweighted because neighbors err alike.
  double deviance() const { return deviance_[0] + deviance_[1] + deviance_[2]; }

 private:
  using Index = std::int64_t;
  struct Channel;
  struct Sums;
  /// Residuals of channel c in image values [n].
  torch::Tensor residuals(std::size_t c, const ChannelModel& model) const;
  torch::Tensor variance(std::size_t c) const;
  void add_points(const Channel& channel, Index part, Sums& sums) const;
  void add_point(const Channel& channel, Index begin, Index end, Sums& sums) const;

  const Observations& s_;
  MediumFitLayout layout_;
  std::vector<Index> first_;  ///< first observation of each point, and the total count
  std::array<torch::Tensor, 3> weights_;
  std::array<torch::Tensor, 3> slopes_;  ///< image value per light [n]
  std::array<double, 3> noise_ = {};
  std::array<double, 3> deviance_ = {};
};

}  // namespace apvi::medium
