// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <optional>

#include "apvi/splat/lamp.hpp"

namespace apvi::splat {

/// The water of a session, the same in every direction. Tensors [3], RGB.
struct Medium {
  torch::Tensor beta_d;  ///< attenuation of the direct light [1/m], positive
  torch::Tensor beta_b;  ///< growth of the backscatter [1/m], positive
  torch::Tensor b_inf;   ///< colour of water without end, in (0, 1)
  std::optional<LampLight> lamp = std::nullopt;  ///< when daylight is not all
};

/// The same, free of bounds, as an optimiser needs it: beta = softplus(raw), b_inf = sigmoid(raw),
/// so that no step leaves the valid range and no gradient dies at its edge.
struct MediumParameters {
  torch::Tensor raw_beta_d;
  torch::Tensor raw_beta_b;
  torch::Tensor raw_b_inf;

  /// Inverse of `medium`. Throws c10::Error when a beta is not positive or b_inf not inside (0, 1).
  static MediumParameters from(const Medium& medium);
  Medium medium() const;
};

/// What lies before a camera's pixels besides the water itself; contiguous, like the image.
struct WaterColumn {
  torch::Tensor ray_lengths;  ///< [H,W] of the rays at unit depth; undefined: one
  torch::Tensor haze;         ///< lamp_haze_table of the camera; undefined: no lamp
};

/// A rendered image as seen through the water, the paper's Eq. (8); where nothing was rendered, the
/// water's own colour. The distance is the range along the ray (the paper takes the depth along the
/// optical axis, up to a third less in the corners of a wide lens). The picture restored from the
/// water needs no function of its own: it is what the renderer draws, `color`, before this.
///
/// `color` [H,W,3] without water and alpha-weighted, `depth` [H,W] in metres and finite (the range
/// where `column` has no ray lengths), `alpha` [H,W]. Differentiable in these and the medium's
/// beta_d, beta_b and b_inf; the haze is taken as given. Throws c10::Error when shapes, types or
/// devices do not agree.
torch::Tensor apply_medium(const torch::Tensor& color, const torch::Tensor& depth,
                           const torch::Tensor& alpha, const Medium& medium,
                           const WaterColumn& column = {});

/// How what the map holds looks from some place: gain * color + veil, [n,3] each.
struct SeenAs {
  torch::Tensor gain;
  torch::Tensor veil;
};
/// At `points` [n,3] in the camera's frame, as `MediumView` has it. Not recorded by autograd.
SeenAs seen_as(const torch::Tensor& points, const Medium& medium);

}  // namespace apvi::splat
