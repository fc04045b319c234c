// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <optional>

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/splat/gaussians.hpp"
#include "apvi/splat/medium.hpp"
#include "apvi/splat/view.hpp"

namespace apvi::mapping {

/// A map with the water it was seen through.
struct Map {
  splat::Gaussians gaussians;
  std::optional<splat::Medium> medium;
  bool antialiased = false;  ///< as it was trained
  /// [n] logarithms of the keyframes' gains: how bright their pictures are over what the map shows;
  /// undefined: all alike.
  torch::Tensor log_gains = {};
  double vignetting = 0.0;  ///< part of the light that the lens loses in the corners
};

/// What a camera sees of a map.
struct Picture {
  torch::Tensor as_seen;   ///< [H,W,3], through the water if there is any
  torch::Tensor restored;  ///< [H,W,3], without it, in the light that falls on the scene from here
  torch::Tensor depth;     ///< [H,W] along the optical axis [m], 0 where nothing is
  torch::Tensor alpha;     ///< [H,W] how much of what is behind is covered
};

/// Draws the map without recording gradients, as a camera of gain one and without vignetting would
/// see it.
Picture take_picture(const Map& map, const splat::View& view);
/// What it would see where nothing is [H,W,3]; undefined without water.
torch::Tensor water_alone(const Map& map, const splat::Intrinsics& camera);

/// The gain of a keyframe [1]: of one to learn from its own; of a held-out one, which was never
/// looked at, what the two before and after it in time make likely.
torch::Tensor camera_gain(const Map& map, const KeyframeStore& keyframes, std::size_t i);
/// What the light at every pixel of a keyframe's camera, reduced by `factor`, is multiplied by
/// [H,W,1]: gain and vignetting.
torch::Tensor camera_response(const Map& map, const KeyframeStore& keyframes, std::size_t i,
                              int factor);

}  // namespace apvi::mapping
