// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

namespace apvi::gaussians {

/// Colored points for map initialization; colors in [0, 1].
struct PointCloud {
  torch::Tensor positions;  ///< [N,3] float32 [m]
  torch::Tensor colors;     ///< [N,3] float32 RGB
};

/// Converts between colors and constant SH coefficients.
torch::Tensor color_to_sh_dc(const torch::Tensor& color);
torch::Tensor sh_dc_to_color(const torch::Tensor& sh_dc);

}  // namespace apvi::gaussians
