// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "mapping/rendering.hpp"

namespace apvi::mapping {

/// Depth [H,W] of the surfaces in a rendering, 0 where unknown. A renderer's expected depth is the
/// mean depth of the Gaussian centers. On a slanted surface, the nearer Gaussians occlude the
/// farther ones, so the mean center is offset from the pixel by a few pixels. The offset is
/// rendered like a color, and depth is extrapolated to the pixel along the surface, whose inverse
/// depth is linear in the pixels if it is planar.
///
/// `depth` and `alpha` [H,W] are the renderer's outputs for `view`. Not recorded by autograd.
torch::Tensor surface_depth(const Map& map, const gaussians::View& view, const torch::Tensor& depth,
                            const torch::Tensor& alpha);

}  // namespace apvi::mapping
