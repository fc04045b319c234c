// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/point_cloud.hpp"

#include <torch/torch.h>

#include "gaussians/render/sh_math.hpp"

namespace apvi::gaussians {

using torch::Tensor;

Tensor color_to_sh_dc(const Tensor& color) {
  return (color - 0.5) / kSh0;
}

Tensor sh_dc_to_color(const Tensor& sh_dc) {
  return sh_dc * kSh0 + 0.5;
}

}  // namespace apvi::gaussians
