// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <optional>

#include "apvi/splat/gaussians.hpp"
#include "apvi/splat/medium.hpp"
#include "apvi/splat/view.hpp"

namespace apvi::mapping {

/// A map with the water it was seen through.
struct Map {
  splat::Gaussians gaussians;
  std::optional<splat::Medium> medium;
  bool antialiased = false;  ///< as it was trained
};

/// What a camera sees of a map.
struct Picture {
  torch::Tensor as_seen;   ///< [H,W,3], through the water if there is any
  torch::Tensor restored;  ///< [H,W,3], without it
  torch::Tensor depth;     ///< [H,W] along the optical axis [m], 0 where nothing is
  torch::Tensor alpha;     ///< [H,W] how much of what is behind is covered
};

/// Draws the map without recording gradients.
Picture take_picture(const Map& map, const splat::View& view);

}  // namespace apvi::mapping
