// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::gaussians {

/// Photometric loss of Gaussian splatting (Kerbl et al., 2023, Eq. 7): (1 - ssim_weight) L1 +
/// ssim_weight (1 - SSIM), both averaged over pixels and channels. SSIM uses an 11 px Gaussian
/// window, sigma 1.5, zero padding, and colors in [0, 1].
///
/// `image`, `target` [H,W,3]. `valid` [H,W], bool or of the images' type: where it is 0 the image
/// is replaced by the target and excluded from the means; undefined: all valid; 0 if none is valid.
/// Differentiable with respect to the image only. Bitwise identical for any number of threads.
/// Throws c10::Error for mismatched shapes, types or devices.
torch::Tensor photometric_loss(const torch::Tensor& image, const torch::Tensor& target,
                               double ssim_weight, const torch::Tensor& valid = {});

}  // namespace apvi::gaussians
