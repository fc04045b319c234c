// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/facing.hpp"

#include <torch/torch.h>

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::nn::functional::normalize;

constexpr double kAlike = 0.2;  // [rad] normals so far apart count a quarter
constexpr int kRounds = 5;

}  // namespace

Tensor prevailing_normals(const Tensor& points, const Tensor& normals, double radius_m) {
  const Tensor near = (torch::cdist(points, points) < radius_m).to(normals.scalar_type());
  Tensor found = normalize(near.mm(normals));
  for (int i = 0; i < kRounds; ++i) {
    const Tensor apart2 = 2.0 - 2.0 * found.mm(normals.t());  // chords, about the angles
    found = normalize((near / (1.0 + apart2 / (kAlike * kAlike)).square()).mm(normals));
  }
  return found;
}

}  // namespace apvi::mapping
