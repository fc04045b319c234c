// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <optional>

#include "apvi/mapping/water_belief.hpp"
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
  torch::Tensor places;    ///< [n,3] float64 in the camera's frame [m]; for a lamp
  torch::Tensor normals;   ///< [n,3] float64 unit vectors there, of either sign; for a lamp
  std::int64_t point_count = 0;
  std::int64_t view_count = 0;
};

/// What is believed of water before anything was seen. Logarithms are normally distributed.
struct WaterPrior {
  splat::Medium medium;     ///< the median
  double beta_sigma = 1.0;  ///< of log(beta_d)
  /// Of log(beta_b / beta_d): what is scattered by a few degrees, 0.3 to 0.5 of all that is
  /// scattered (Petzold, "Volume scattering functions for selected ocean waters", 1972), is lost to
  /// the scene's picture and not to the veil; scattering is a tenth of the attenuation in clear
  /// water and two thirds in turbid.
  double log_ratio = -0.12;
  double ratio_sigma = 0.15;
  double b_inf_sigma = 1.0;       ///< of log(b_inf)
  double gain_sigma = 0.5;        ///< of the logarithm of a view's gain
  double vignetting_sigma = 0.3;  ///< of the light lost in the corners
  /// On the vehicle; without, daylight is all. Its light at one metre counts as much as it must.
  std::optional<splat::Lamp> lamp = std::nullopt;
  double daylight = 0.1;  ///< its part of the light where the lamp's counts as one
  double daylight_sigma = 0.1;
  double glow = 0.02;        ///< of the water before the camera over the brightness of that light
  double glow_sigma = 1.5;   ///< of its logarithm
  WaterBelief surveys = {};  ///< what was found before
};

/// Coastal water. With a lamp on the vehicle the veil is what daylight is left, which may be a
/// hundredth of the coast's: the coast's own would hold it up where it is too dark for pictures to
/// say much against that.
WaterPrior usual_prior(const std::optional<splat::Lamp>& lamp = std::nullopt,
                       const WaterBelief& surveys = {});

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
  WaterBelief surveys;   ///< the prior's and this one
};

/// The most probable water: I = g (1 - v r^2) (J exp(-beta_d z) + b_inf (1 - exp(-beta_b z))) for
/// every sighting, with a colour J for each point, a gain g for each view and one vignetting v.
/// With a lamp the direct light is L J and there is its glow besides (splat::LampLight); there L
/// knows the angle at which the lamp shines on the surface. Robust Gauss-Newton; the colours are
/// eliminated (variable projection). What the sightings do not tell stays as the prior has it.
/// Where the prior has surveys, attenuation is what all say together, and the rest is fitted to
/// that. Nothing when the sightings are too few.
std::optional<WaterFit> fit_water(const Sightings& sightings, const WaterPrior& prior);

}  // namespace apvi::mapping
