// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "medium/medium.hpp"
#include "medium/medium_posterior.hpp"
#include "medium/vignetting.hpp"

namespace apvi::medium {

/// Colors of the same surface points in several views; n observations, all tensors on the CPU.
struct Observations {
  torch::Tensor points;    ///< [n] int64, 0 to `point_count` - 1
  torch::Tensor views;     ///< [n] int64, 0 to `view_count` - 1
  torch::Tensor ranges;    ///< [n] float64 along the ray [m]
  torch::Tensor corners2;  ///< [n] float64 squared distance from the principal point, 1 in a corner
  torch::Tensor colors;    ///< [n,3] float64, light in [0, 1], from the same patch of surface
  torch::Tensor slopes;    ///< [n,3] float64 image value per light, in which the noise is uniform;
                           ///< undefined: one
  torch::Tensor texture;   ///< [n] float64 local variation of image values
  torch::Tensor places;    ///< [n,3] float64 point in the camera frame [m]; for a lamp
  torch::Tensor normals;   ///< [n,3] float64 unit surface normal, of either sign; for a lamp
  std::int64_t point_count = 0;
  std::int64_t view_count = 0;
};

/// Prior of the medium and camera parameters. Logarithms are normally distributed.
struct MediumPrior {
  Medium medium;            ///< median; by daylight b_inf is for images of mean light 0.4
  double beta_sigma = 1.0;  ///< of log(beta_d)
  /// Of log(beta_b / beta_d). Light scattered forward by a few degrees, 0.3 to 0.5 of all scattered
  /// light (Petzold, "Volume scattering functions for selected ocean waters", 1972), attenuates the
  /// direct signal but does not contribute to the veiling light: less than 1. Along a ray that
  /// looks down, daylight fades with depth, so that the veiling light saturates sooner: more
  /// than 1.
  double log_ratio = 0.0;
  double ratio_sigma = 0.3;
  double b_inf_sigma = 1.0;       ///< of log(b_inf)
  double gain_sigma = 0.5;        ///< of the logarithm of a view's exposure gain
  double vignetting_sigma = 0.7;  ///< of both coefficients of Vignetting
  /// Lamps on the vehicle; without them, all light is daylight. Their intensity at one meter is a
  /// free parameter, and so is the shape of their beams, common to all.
  std::vector<Lamp> lamps = {};
  double half_beam_sigma = 0.15;  ///< of the logarithm of the lamps' half beam angles
  double edge_sigma = 0.3;        ///< of the lamps' edges
  double daylight = 0.02;         ///< daylight relative to the total light at unit range
  double daylight_sigma = 0.05;
  double lamp_backscatter = 0.02;       ///< [1/m] relative to the light at unit range
  double lamp_backscatter_sigma = 1.5;  ///< of its logarithm
  MediumPosterior posterior = {};       ///< what was found before
};

/// Coastal water. With a lamp, the veiling light only comes from the remaining daylight, which may
/// be a hundredth of the coastal value; the coastal prior would bias it upward where images are too
/// dark to constrain it.
MediumPrior default_medium_prior(const std::vector<Lamp>& lamps = {},
                                 const MediumPosterior& posterior = {});

/// Medium and camera parameters estimated from observations of the same surfaces at different
/// ranges.
struct MediumFit {
  Medium medium;            ///< float64, at the mean gain of the views
  torch::Tensor log_gains;  ///< [view_count] float64, of zero mean
  Vignetting vignetting;
  /// [3,3,3] float64, by channel: model resolution matrix of the logarithms of beta_d, beta_b and
  /// b_inf, 1 - covariance * prior information: the identity where the data determine the
  /// parameters, zero in directions that only the prior constrains, for example with all
  /// observations at one range.
  torch::Tensor resolution;
  torch::Tensor sigmas;   ///< [3,3] float64, by channel: standard deviations of the same logarithms
  torch::Tensor noise;    ///< [3] float64 noise of an observation, in image values
  double deviance = 0.0;  ///< -2 log likelihood of the image values, up to a constant
  MediumPosterior posterior;  ///< that of the prior, updated with this fit
};

/// Maximum a posteriori estimate of the medium. Each observation follows I = g v (J
/// exp(-beta_d z) + b_inf (1 - exp(-beta_b z))) with a color J per point, a gain g per view and the
/// lens's vignetting v. With a lamp, the direct light is L J and the backscatter of the lamp
/// is added (LampLight); L includes the lamps' angles of incidence on the surface. Robust
/// Gauss-Newton with the colors eliminated (variable projection). Directions that the observations
/// do not constrain keep the prior. If the prior contains a posterior of earlier fits, attenuation
/// is fixed to the fused value and the other parameters are fitted again. Returns nothing with too
/// few observations.
std::optional<MediumFit> fit_medium(const Observations& observations, const MediumPrior& prior);

/// `MediumFit::deviance` of the same observations explained without a medium: by colors, gains,
/// vignetting and the lamp alone.
double deviance_without_medium(const Observations& observations, MediumPrior prior);

}  // namespace apvi::medium
