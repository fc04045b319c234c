// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/quaternions.hpp"

#include <torch/torch.h>

#include <vector>

#include "gaussians/model/symmetric_eigen.hpp"

namespace apvi::gaussians {

using torch::Tensor;

Tensor rotations_of(const Tensor& quaternions) {
  const auto q = (quaternions / quaternions.norm(2, 1, true)).unbind(1);
  const Tensor &w = q[0], &x = q[1], &y = q[2], &z = q[3];
  return torch::stack({1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                       2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                       2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)},
                      1)
      .view({-1, 3, 3});
}

Tensor quaternion_products(const Tensor& a, const Tensor& b) {
  const std::vector<Tensor> p = a.unbind(1);
  const std::vector<Tensor> q = b.unbind(1);
  return torch::stack({p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
                       p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
                       p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
                       p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]},
                      1);
}

Tensor quaternions_of(const Tensor& R) {
  const auto r = [&](int row, int column) { return R.select(1, row).select(1, column); };
  const Tensor K = torch::stack(
      {r(0, 0) + r(1, 1) + r(2, 2), r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1),  //
       r(2, 1) - r(1, 2), r(0, 0) - r(1, 1) - r(2, 2), r(1, 0) + r(0, 1), r(0, 2) + r(2, 0),  //
       r(0, 2) - r(2, 0), r(1, 0) + r(0, 1), r(1, 1) - r(0, 0) - r(2, 2), r(2, 1) + r(1, 2),  //
       r(1, 0) - r(0, 1), r(0, 2) + r(2, 0), r(2, 1) + r(1, 2), r(2, 2) - r(0, 0) - r(1, 1)},
      1);
  const Tensor q = std::get<1>(symmetric_eigen(K.reshape({-1, 4, 4}))).select(2, 3);
  return q * q.gather(1, q.abs().argmax(1, true)).sign();  // eigenvectors have arbitrary sign
}

}  // namespace apvi::gaussians
