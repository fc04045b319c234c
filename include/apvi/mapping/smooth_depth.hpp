// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::mapping {

/// How bent the surfaces of a rendering are where the picture is even, a mean over its pixels:
/// second differences of inverse depth, which is linear in the pixels on a plane, over the mean
/// inverse depth, and the less counted the more the picture changes there. What a picture does not
/// tell, as sand in the dark, goes on from around it instead of floating anywhere before the
/// camera.
///
/// `depth` and `alpha` [H,W] of the rendering, `picture` [H,W,3]. Differentiable in depth. Zero
/// for pictures of fewer than 80 rows or columns. Edge-aware smoothness as in Godard et al.,
/// "Unsupervised monocular depth estimation with left-right consistency" (CVPR 2017), of second
/// order.
torch::Tensor bentness(const torch::Tensor& depth, const torch::Tensor& alpha,
                       const torch::Tensor& picture);

}  // namespace apvi::mapping
