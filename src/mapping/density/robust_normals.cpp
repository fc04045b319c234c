// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/robust_normals.hpp"

#include <torch/torch.h>

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::nn::functional::normalize;

constexpr double kNormalScale_rad = 0.2;  // weight 1/4 at this angle
constexpr int kIterations = 5;

}  // namespace

Tensor robust_normals(const Tensor& points, const Tensor& normals, double radius_m) {
  const Tensor near = (torch::cdist(points, points) < radius_m).to(normals.scalar_type());
  Tensor result = normalize(near.mm(normals));
  for (int i = 0; i < kIterations; ++i) {
    const Tensor distance2 = 2.0 - 2.0 * result.mm(normals.t());  // squared chord lengths
    result = normalize(
        (near / (1.0 + distance2 / (kNormalScale_rad * kNormalScale_rad)).square()).mm(normals));
  }
  return result;
}

}  // namespace apvi::mapping
