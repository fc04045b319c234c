// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::splat {

/// How far a rendered image is from what the camera saw, as Gaussian splatting is trained (Kerbl et
/// al., 2023, Eq. 7): (1 - ssim_weight) L1 + ssim_weight (1 - SSIM), both means over pixels and
/// channels. SSIM with a Gaussian window of 11 pixels, sigma 1.5, beyond the border zeros, for
/// colours in [0, 1].
///
/// `image`, `target` [H,W,3]. `valid` [H,W], bool or of the images' type: where it is 0 the image
/// counts as equal to the target, and the means are over the others; undefined: all count; with
/// none at all the loss is 0. Differentiable in the image alone. The same bits with any number of
/// threads. Throws c10::Error when shapes, types or devices do not agree.
torch::Tensor photometric_loss(const torch::Tensor& image, const torch::Tensor& target,
                               double ssim_weight, const torch::Tensor& valid = {});

}  // namespace apvi::splat
