// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>
#include <vector>

#include "apvi/mapping/water_fit.hpp"
#include "water_model.hpp"

namespace apvi::mapping {

/// The same sightings, those of a point in a row, in the order of their views.
Sightings by_point(const Sightings& sightings);

/// Robust normal equations of what sightings look like, with the points' colours eliminated
/// (variable projection). Parameters: `own` for each channel, the vignetting, the logarithms of the
/// views' gains. A point's sightings touch few of them, so sums go over these alone.
class WaterEquations {
 public:
  /// `sightings` as `by_point` has them; they must outlive this.
  WaterEquations(const Sightings& sightings, std::int64_t own);

  /// Adds what channel c says to the information A [m,m] and the gradient b [m] of half the
  /// weighted squares, float64. Weights follow from what the last ones leave. `falloff` [n] of the
  /// lens.
  void add(std::int64_t c, const ChannelModel& model, const torch::Tensor& falloff,
           torch::Tensor& A, torch::Tensor& b);

  /// Of a sighting's colour, by channel.
  const std::array<double, 3>& noise() const { return noise_; }

 private:
  using Index = std::int64_t;
  struct Channel;
  struct Sums;
  void add_points(const Channel& channel, Index part, Sums& sums) const;
  void add_point(const Channel& channel, Index begin, Index end, Sums& sums) const;

  const Sightings& s_;
  Index own_;
  std::vector<Index> first_;  ///< sighting of each point, and one behind the last
  std::array<torch::Tensor, 3> weights_;
  std::array<double, 3> noise_ = {};
};

}  // namespace apvi::mapping
