// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/render/view.hpp"

#include <torch/torch.h>

namespace apvi::gaussians {

Intrinsics Intrinsics::scaled(int new_width, int new_height) const {
  TORCH_CHECK(width > 0 && height > 0 && new_width > 0 && new_height > 0,
              "intrinsics: cannot scale ", width, "x", height, " to ", new_width, "x", new_height);
  const double x = static_cast<double>(new_width) / width;
  const double y = static_cast<double>(new_height) / height;
  return {.fx = fx * x,
          .fy = fy * y,
          .cx = cx * x,
          .cy = cy * y,
          .width = new_width,
          .height = new_height,
          .lens_spread = lens_spread};
}

}  // namespace apvi::gaussians
