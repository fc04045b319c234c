// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <optional>

#include "medium/lamp.hpp"

namespace apvi::medium {

/// Homogeneous medium of a session. Tensors [3], RGB.
struct Medium {
  torch::Tensor beta_d;  ///< attenuation coefficient of the direct light [1/m], positive
  torch::Tensor beta_b;  ///< backscatter coefficient [1/m], positive
  torch::Tensor b_inf;   ///< veiling light: color of water at infinite range, in (0, 1)
  std::optional<LampLight> lamp = std::nullopt;  ///< if the scene is not lit by daylight alone
};

/// Unconstrained parameters for optimization: beta = softplus(raw), b_inf = sigmoid(raw), so steps
/// stay in the valid range and gradients do not vanish at its bounds.
struct MediumParameters {
  torch::Tensor raw_beta_d;
  torch::Tensor raw_beta_b;
  torch::Tensor raw_b_inf;

  /// Inverse of `medium`. Throws c10::Error when a beta is not positive or b_inf not inside (0, 1).
  static MediumParameters from(const Medium& medium);
  Medium medium() const;
};

/// Per-camera data for `apply_medium`; contiguous, like the image.
struct MediumViewData {
  torch::Tensor ray_lengths;       ///< [H,W] ray length at unit depth; undefined: one
  torch::Tensor lamp_backscatter;  ///< lamp_backscatter_table of the camera; undefined: no lamp
};

/// Applies the medium to a rendered image, Eq. (8) of the paper; pixels with nothing rendered get
/// the color of open water. The distance is the range along the ray (the paper uses depth along the
/// optical axis, up to a third less in the corners of a wide-angle lens). The restored image is the
/// renderer's `color` itself.
///
/// `color` [H,W,3] without medium and alpha-weighted, `depth` [H,W] in meters and finite (the range
/// if `view_data` has no ray lengths), `alpha` [H,W]. Differentiable in these and in the medium's
/// beta_d, beta_b and b_inf; the lamp backscatter is treated as constant. Throws c10::Error when
/// shapes, types or devices do not match.
torch::Tensor apply_medium(const torch::Tensor& color, const torch::Tensor& depth,
                           const torch::Tensor& alpha, const Medium& medium,
                           const MediumViewData& view_data = {});

/// Effect of the medium on map colors: observed color = gain * color + veiling_light, [n,3] each.
struct MediumTransfer {
  torch::Tensor gain;
  torch::Tensor veiling_light;
};
/// At `points` [n,3] in the camera frame, consistent with `MediumView`. Not recorded by autograd.
MediumTransfer medium_transfer(const torch::Tensor& points, const Medium& medium);

}  // namespace apvi::medium
