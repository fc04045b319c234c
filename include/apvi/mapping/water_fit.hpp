// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <optional>

#include "apvi/splat/medium.hpp"

namespace apvi::mapping {

/// Points of surfaces as views saw them; n sightings, all tensors on the CPU.
struct Sightings {
  torch::Tensor points;    ///< [n] int64, 0 to `point_count` - 1
  torch::Tensor views;     ///< [n] int64, 0 to `view_count` - 1
  torch::Tensor ranges;    ///< [n] float64 along the ray [m]
  torch::Tensor corners2;  ///< [n] float64 squared distance from the principal point, 1 in a corner
  torch::Tensor colors;    ///< [n,3] float64 in [0, 1], from the same patch of surface in all views
  torch::Tensor texture;   ///< [n] float64 how much the colour changes around it
  std::int64_t point_count = 0;
  std::int64_t view_count = 0;
};

/// What is believed of water before anything was seen. Logarithms are normally distributed.
struct WaterPrior {
  splat::Medium medium;     ///< the median
  double beta_sigma = 1.0;  ///< of log(beta_d)
  /// Of log(beta_b / beta_d), about 0: what light loses on its way in and on its way out is nearly
  /// alike.
  double ratio_sigma = 0.15;
  double b_inf_sigma = 1.0;       ///< of log(b_inf)
  double gain_sigma = 0.5;        ///< of the logarithm of a view's gain
  double vignetting_sigma = 0.3;  ///< of the light lost in the corners
};

/// Water and camera that explain how the same surfaces look from near and far.
struct WaterFit {
  splat::Medium medium;     ///< float64, at a view of mean gain
  torch::Tensor log_gains;  ///< [view_count] float64, of zero mean
  double vignetting = 0.0;  ///< part of the light lost in the corners
  /// [3,3,3] float64, by channel: of the logarithms of beta_d, beta_b and b_inf, which part of a
  /// deviation from the prior the sightings stand for: one where they say all, zero in directions
  /// they say nothing about, because all is seen from one distance.
  torch::Tensor known;
  torch::Tensor sigmas;  ///< [3,3] float64, by channel: one sigma of the same logarithms
  torch::Tensor noise;   ///< [3] float64, of a sighting's colour
};

/// The most probable water: I = g (1 - v r^2) (J exp(-beta_d z) + b_inf (1 - exp(-beta_b z))) for
/// every sighting, with a colour J for each point, a gain g for each view and one vignetting v.
/// Robust Gauss-Newton; the colours are eliminated (variable projection). What the sightings do not
/// tell stays as the prior has it. Nothing when they are too few.
std::optional<WaterFit> fit_water(const Sightings& sightings, const WaterPrior& prior);

}  // namespace apvi::mapping
