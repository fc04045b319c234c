// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/splat/similarity.hpp"

#include <torch/torch.h>

#include <cmath>

#include "apvi/splat/sh_math.hpp"

namespace apvi::splat {
namespace {

using torch::Tensor;

/// Directions [D,3] spread over the sphere along a spiral (Swinbank and Purser, 2006).
Tensor spread_directions(std::int64_t count) {
  const double golden_angle = M_PI * (3.0 - std::sqrt(5.0));
  const Tensor i = torch::arange(count, torch::kFloat64);
  const Tensor z = 1.0 - (2.0 * i + 1.0) / static_cast<double>(count);
  const Tensor radius = torch::sqrt(1.0 - z * z);
  return torch::stack(
      {radius * torch::cos(golden_angle * i), radius * torch::sin(golden_angle * i), z}, 1);
}

/// Values [D,K] of the basis for directions [D,3].
Tensor sh_values(int degree, const Tensor& directions) {
  const Tensor d = directions.contiguous();
  Tensor values = torch::empty({d.size(0), sh_rest_count(degree)}, torch::kFloat64);
  for (std::int64_t i = 0; i < d.size(0); ++i) {
    const double* const v = d.data_ptr<double>() + 3 * i;
    sh_basis(degree, v[0], v[1], v[2], values.data_ptr<double>() + i * values.size(1));
  }
  return values;
}

/// Product of quaternions w x y z, [4] and [N,4].
Tensor quaternion_product(const Tensor& a, const Tensor& b) {
  const auto w = b.select(1, 0);
  const auto x = b.select(1, 1);
  const auto y = b.select(1, 2);
  const auto z = b.select(1, 3);
  const Tensor c = a.to(b.options());
  return torch::stack(
      {c[0] * w - c[1] * x - c[2] * y - c[3] * z, c[0] * x + c[1] * w + c[2] * z - c[3] * y,
       c[0] * y - c[1] * z + c[2] * w + c[3] * x, c[0] * z + c[1] * y - c[2] * x + c[3] * w},
      1);
}

/// Unit quaternion [4] w x y z of a rotation matrix: the eigenvector of the largest eigenvalue of
/// Bar-Itzhack's matrix (2000), which has no case to tell apart.
Tensor quaternion_of(const Tensor& R) {
  const auto r = R.accessor<double, 2>();
  const Tensor K = torch::tensor(
      {r[0][0] + r[1][1] + r[2][2], r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1],  //
       r[2][1] - r[1][2], r[0][0] - r[1][1] - r[2][2], r[1][0] + r[0][1], r[0][2] + r[2][0],  //
       r[0][2] - r[2][0], r[1][0] + r[0][1], r[1][1] - r[0][0] - r[2][2], r[2][1] + r[1][2],  //
       r[1][0] - r[0][1], r[0][2] + r[2][0], r[2][1] + r[1][2], r[2][2] - r[0][0] - r[1][1]},
      torch::kFloat64);
  const Tensor q = std::get<1>(torch::linalg_eigh(K.reshape({4, 4}))).select(1, 3);
  return q * q.index_select(0, q.abs().argmax()).sign();  // an eigenvector comes with either sign
}

void check(const Similarity& similarity) {
  TORCH_CHECK(similarity.scale > 0.0 && std::isfinite(similarity.scale),
              "similarity: the scale must be positive, not ", similarity.scale);
  const Tensor& R = similarity.R;
  TORCH_CHECK(R.defined() && R.sizes() == at::IntArrayRef({3, 3}) && R.device().is_cpu() &&
                  R.scalar_type() == torch::kFloat64,
              "similarity: R must be [3,3] float64 on the CPU");
  const Tensor excess = torch::matmul(R, R.t()) - torch::eye(3, torch::kFloat64);
  TORCH_CHECK(excess.abs().max().item<double>() < 1e-6 && torch::det(R).item<double>() > 0.0,
              "similarity: R is no rotation");
  TORCH_CHECK(similarity.t.defined() && similarity.t.sizes() == at::IntArrayRef({3}),
              "similarity: t must be [3]");
}

}  // namespace

Tensor sh_rotation(int degree, const Tensor& R) {
  // Each degree's functions of a rotated direction are combinations of themselves. So the matrix
  // follows from their values at more directions than there are coefficients.
  const Tensor directions = spread_directions(64);
  const Tensor values = sh_values(degree, directions);
  const Tensor turned_back = sh_values(degree, torch::matmul(directions, R));
  return torch::matmul(torch::pinverse(values), turned_back);
}

Gaussians transformed(const Gaussians& gaussians, const Similarity& similarity) {
  check(similarity);
  const torch::NoGradGuard no_grad;
  const auto like = gaussians.means.options();
  const Tensor means = gaussians.means.to(torch::kFloat64);
  const auto on_device = torch::dtype(torch::kFloat64).device(like.device());
  Gaussians out = gaussians;
  out.means = (similarity.scale * torch::matmul(means, similarity.R.t().to(on_device)) +
               similarity.t.to(on_device))
                  .to(like);
  out.log_scales = gaussians.log_scales + std::log(similarity.scale);
  out.quaternions = quaternion_product(quaternion_of(similarity.R), gaussians.quaternions);
  const int degree = gaussians.sh_degree();
  if (degree > 0) {
    out.sh_rest = torch::matmul(sh_rotation(degree, similarity.R).to(like), gaussians.sh_rest);
  }
  return out;
}

}  // namespace apvi::splat
