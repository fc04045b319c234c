// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::mapping {

/// Mean curvature of the rendered surfaces where the image has little texture: second differences
/// of inverse depth, which is linear in the pixels on a plane, divided by the mean inverse depth
/// and weighted down by the image gradient. Continues surfaces smoothly into areas without texture,
/// such as dark sand, where depth is not observable and floaters would form.
///
/// `depth` and `alpha` [H,W] of the rendering, `image` [H,W,3]. Differentiable in depth. Zero for
/// images of fewer than 80 rows or columns. Edge-aware smoothness as in Godard et al.,
/// "Unsupervised monocular depth estimation with left-right consistency" (CVPR 2017), of second
/// order.
torch::Tensor depth_curvature_loss(const torch::Tensor& depth, const torch::Tensor& alpha,
                                   const torch::Tensor& image);

}  // namespace apvi::mapping
