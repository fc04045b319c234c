// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include "apvi/mapping/rendering.hpp"

namespace apvi::mapping {

/// Depth [H,W] of the surfaces that a rendering shows, 0 where nothing is. A renderer's expected
/// depth is the mean of the depths of the Gaussians' centres, and of a surface seen aslant those
/// before a pixel cover those behind: the mean centre lies some pixels from the pixel, where the
/// surface is nearer. Where it lies is drawn like a colour; the depth is then carried over to the
/// pixel along the surface, whose inverse depth is linear in the pixels if it is flat.
///
/// `depth` and `alpha` [H,W] are the renderer's for `view`. Not recorded by autograd.
torch::Tensor surface_depth(const Map& map, const splat::View& view, const torch::Tensor& depth,
                            const torch::Tensor& alpha);

}  // namespace apvi::mapping
