// SPDX-License-Identifier: BSD-3-Clause
#include "survey/projection.hpp"

#include <torch/torch.h>

namespace apvi::survey {

Projection project(const gaussians::View& view, const torch::Tensor& points) {
  using torch::Tensor;
  const gaussians::Intrinsics& k = view.intrinsics;
  const Tensor T = view.T_camera_world.to(points.options());
  const Tensor p = points.mm(T.slice(0, 0, 3).slice(1, 0, 3).t()) + T.slice(0, 0, 3).select(1, 3);
  const Tensor z = p.select(1, 2);
  const Tensor u = (k.fx * p.select(1, 0) / z + k.cx).floor();
  const Tensor v = (k.fy * p.select(1, 1) / z + k.cy).floor();
  const Tensor inside = (z > 0.0) & (u >= 0.0) & (u < k.width) & (v >= 0.0) & (v < k.height);
  const Tensor index = torch::where(inside, v * k.width + u, torch::zeros_like(u));
  return {index.to(torch::kInt64), z, inside};
}

}  // namespace apvi::survey
