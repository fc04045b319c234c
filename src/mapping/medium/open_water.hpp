// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>
#include <utility>

#include "gaussians/render/view.hpp"

namespace apvi::mapping {

/// Pixels at x, y [px] look above the horizon where a x + b y + c > 0: {a, b, c}. Assumes that the
/// world's z axis points up.
using Horizon = std::array<float, 3>;
inline constexpr Horizon kNoSky{0.0F, 0.0F, -1.0F};
Horizon horizon(const gaussians::View& camera);
/// Mask of the pixels above the horizon: bool [H,W].
torch::Tensor above_horizon(const Horizon& horizon, std::int64_t height, std::int64_t width,
                            const torch::Device& device);

/// Mask of open water, bool [H,W], in an image [H,W,3] where open water would have the color
/// `water` [H,W,3] (medium::MediumView::open_water): uniform over a window of several pixels and
/// close to that color. Distant surfaces that have converged to the veiling light count as open
/// water.
///
/// Gaussians with the color of the water would match these pixels at any depth, and remain as
/// floaters once the medium is removed. So none are inserted there, and those that extend into the
/// mask are made transparent.
torch::Tensor open_water(const torch::Tensor& image, const torch::Tensor& water);

/// Classifies the pixels of an image [H,W,3] against open water of color `water` [H,W,3], int8
/// [H,W]: 1 open water, -1 certainly a surface, 0 ambiguous.
torch::Tensor classify_water(const torch::Tensor& image, const torch::Tensor& water);

/// Weights of the opacity loss relative to the photometric loss, by pixel class.
struct OpacityWeights {
  double open = 0.0;     ///< toward transparent, in open water
  double edge = 0.0;     ///< toward transparent, within a few pixels of open water
  double surface = 0.0;  ///< toward opaque, on surfaces that are fully transparent
};
inline constexpr OpacityWeights kDaylightOpacityWeights{.open = 2.0, .edge = 0.3, .surface = 0.5};
/// With a lamp, dim surfaces resemble dark water.
inline constexpr OpacityWeights kLampOpacityWeights{.open = 1.0, .edge = 0.0, .surface = 0.0};

/// Gradient [H,W] of an opacity loss, summed over the pixels, with respect to a rendering's `alpha`
/// [H,W], so that each pixel becomes either open water or a surface. The photometric loss alone is
/// ambiguous: a translucent surface in front of open water looks like a more distant one and turns
/// too dark once the medium is removed, and an edge with the color of the water looks like a
/// translucent one and turns too bright. So opacity is reduced in open water, at edges beside it as
/// far as the image allows with non-negative colors, and increased elsewhere. (SeaSplat, Yang et
/// al., 2024, reduces opacity where an image has the color of the water.)
torch::Tensor opacity_loss_gradient(const torch::Tensor& image, const torch::Tensor& water,
                                    const torch::Tensor& alpha, const OpacityWeights& weights);

/// Local mean color [3,H,W] of an image [H,W,3] in a window, and whether the window is uniform up
/// to noise, bool [H,W].
std::pair<torch::Tensor, torch::Tensor> local_uniformity(const torch::Tensor& image);

}  // namespace apvi::mapping
