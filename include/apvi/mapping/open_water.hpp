// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <array>
#include <cstdint>
#include <utility>

#include "apvi/splat/view.hpp"

namespace apvi::mapping {

/// Pixels at x, y [px] look above the horizon where a x + b y + c > 0: {a, b, c}. The world's z is
/// up; where it is not, what is taken for the sky is hardly ever of one colour, and that the
/// water's.
using Horizon = std::array<float, 3>;
inline constexpr Horizon kNoSky{0.0F, 0.0F, -1.0F};
Horizon horizon(const splat::View& camera);
/// Which pixels of height x width look above it: bool [H,W].
torch::Tensor above(const Horizon& horizon, std::int64_t height, std::int64_t width,
                    const torch::Device& device);

/// Where a picture [H,W,3] shows nothing but water, which would look like `water` [H,W,3] there
/// (splat::MediumView::open_water): bool [H,W]. Even over a square of several pixels and of nearly
/// that colour; a surface so far off that it has the water's colour counts as water.
///
/// Gaussians of the water's colour would look right there from everywhere, at any distance, and be
/// left when the water is taken away. So none are made there, and those that reach in are let go.
torch::Tensor open_water(const torch::Tensor& picture, const torch::Tensor& water);

/// What a picture [H,W,3] shows where `water` would look like [H,W,3], int8 [H,W]: 1 open water, -1
/// surely a surface, 0 one of both.
torch::Tensor water_kinds(const torch::Tensor& picture, const torch::Tensor& water);

/// Weights of opacity beside a picture's photometric loss, by what a pixel shows.
struct OpacityWeights {
  double open = 0.0;     ///< for letting through
  double edge = 0.0;     ///< the same a few pixels from open water
  double surface = 0.0;  ///< for closing, of what lets all through
};
inline constexpr OpacityWeights kByDaylight{.open = 2.0, .edge = 0.3, .surface = 0.5};
/// A dim surface looks much like the dark water before it.
inline constexpr OpacityWeights kByLamplight{.open = 1.0, .edge = 0.0, .surface = 0.0};

/// By how much a loss should grow [H,W] with a drawing's `alpha` [H,W], summed over the pixels, so
/// that a pixel is either water or a surface. Pictures alone do not say: what is translucent before
/// open water looks like something farther off, and without the water it is too dark; an edge of
/// the water's colour looks like one that is half transparent, and without the water it glows. So
/// open water is let through, edges beside it as much as the picture allows with colours that are
/// no less than black, and all else is closed. (SeaSplat, Yang et al., 2024, lets go of opacity
/// where a picture has the water's colour.)
torch::Tensor opacity_pull(const torch::Tensor& picture, const torch::Tensor& water,
                           const torch::Tensor& alpha, const OpacityWeights& weights);

/// The mean colour [3,H,W] of a square around each pixel of a picture [H,W,3], and whether it is
/// even [H,W] bool, but for noise.
std::pair<torch::Tensor, torch::Tensor> evenness(const torch::Tensor& picture);

}  // namespace apvi::mapping
