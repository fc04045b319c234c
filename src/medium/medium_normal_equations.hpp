// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>
#include <vector>

#include "medium/medium_fit.hpp"
#include "medium/medium_observation_model.hpp"

namespace apvi::medium {

/// Coefficients of Vignetting.
inline constexpr std::int64_t kVignettingParameters = 2;

/// The same observations, sorted by point and then by view.
Observations sorted_by_point(const Observations& observations);

/// Robust normal equations of the observations with the points' colors eliminated (variable
/// projection). Parameters: `own` per channel, those of the vignetting, the logarithms of the
/// views' gains. Each point involves few of these, so sums only run over the affected columns.
class MediumNormalEquations {
 public:
  /// `observations` must be sorted by `sorted_by_point` and outlive this.
  MediumNormalEquations(const Observations& observations, std::int64_t own);

  /// Adds channel c to the information matrix A [m,m] and the gradient b [m] of half the weighted
  /// sum of squares, float64. Weights follow from the residuals of the last call.
  void add(std::int64_t c, const ChannelModel& model, torch::Tensor& A, torch::Tensor& b);

  /// Noise of an observation in image values, by channel.
  const std::array<double, 3>& noise() const { return noise_; }
  /// Minus twice the logarithm of the likelihood of the last residuals as image values, up to a
  /// constant; observations are downweighted because neighbors err alike.
  double deviance() const { return deviance_[0] + deviance_[1] + deviance_[2]; }

 private:
  using Index = std::int64_t;
  struct Channel;
  struct Sums;
  void add_points(const Channel& channel, Index part, Sums& sums) const;
  void add_point(const Channel& channel, Index begin, Index end, Sums& sums) const;

  const Observations& s_;
  Index own_;
  std::vector<Index> first_;  ///< first observation of each point, and the total count
  std::array<torch::Tensor, 3> weights_;
  std::array<double, 3> noise_ = {};
  std::array<double, 3> deviance_ = {};
};

}  // namespace apvi::medium
