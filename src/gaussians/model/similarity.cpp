// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/similarity.hpp"

#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "gaussians/model/quaternions.hpp"
#include "gaussians/render/sh_math.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

constexpr std::int64_t kRowsPerBatch = 65536;

/// Directions [D,3] on a Fibonacci spiral over the sphere (Swinbank and Purser, 2006).
Tensor spread_directions(std::int64_t count) {
  const double golden_angle = M_PI * (3.0 - std::sqrt(5.0));
  const Tensor i = torch::arange(count, torch::kFloat64);
  const Tensor z = 1.0 - (2.0 * i + 1.0) / static_cast<double>(count);
  const Tensor radius = torch::sqrt(1.0 - z * z);
  return torch::stack(
      {radius * torch::cos(golden_angle * i), radius * torch::sin(golden_angle * i), z}, 1);
}

/// SH basis values [...,K] for directions [...,3].
Tensor sh_values(int degree, const Tensor& directions) {
  const Tensor d = directions.reshape({-1, 3}).contiguous();
  std::vector<std::int64_t> shape = directions.sizes().vec();
  shape.back() = sh_rest_count(degree);
  Tensor values = torch::empty(shape, torch::kFloat64);
  double* out = values.data_ptr<double>();
  for (std::int64_t i = 0; i < d.size(0); ++i, out += shape.back()) {
    const double* const v = d.data_ptr<double>() + 3 * i;
    sh_basis(degree, v[0], v[1], v[2], out);
  }
  return values;
}

void check(const SimilarityTransforms& s) {
  TORCH_CHECK(s.scales.defined() && s.scales.dim() == 1 && s.scales.device().is_cpu() &&
                  s.scales.scalar_type() == torch::kFloat64,
              "similarities: scales must be [M] float64 on the CPU");
  const std::int64_t count = s.scales.size(0);
  TORCH_CHECK(s.R.defined() && s.R.sizes() == at::IntArrayRef({count, 3, 3}) &&
                  s.R.device().is_cpu() && s.R.scalar_type() == torch::kFloat64,
              "similarities: R must be [M,3,3] float64 on the CPU");
  TORCH_CHECK(s.t.defined() && s.t.sizes() == at::IntArrayRef({count, 3}),
              "similarities: t must be [M,3]");
  if (count == 0) return;
  TORCH_CHECK(((s.scales > 0.0) & torch::isfinite(s.scales)).all().item<bool>(),
              "similarities: a scale must be positive");
  const Tensor excess = torch::matmul(s.R, s.R.transpose(1, 2)) - torch::eye(3, torch::kFloat64);
  TORCH_CHECK(
      excess.abs().max().item<double>() < 1e-6 && (torch::det(s.R) > 0.0).all().item<bool>(),
      "similarities: R is not a rotation");
}

/// `sh_rest` [N,K,3], each rotated by matrix number `which` [N] of `rotations` [M,K,K]; in batches,
/// as one matrix per Gaussian would exceed the memory of the map.
Tensor rotated(const Tensor& sh_rest, const Tensor& rotations, const Tensor& which) {
  std::vector<Tensor> parts;
  for (std::int64_t begin = 0; begin < which.size(0); begin += kRowsPerBatch) {
    const std::int64_t end = std::min(begin + kRowsPerBatch, which.size(0));
    parts.push_back(torch::matmul(rotations.index_select(0, which.slice(0, begin, end)),
                                  sh_rest.slice(0, begin, end)));
  }
  return parts.empty() ? sh_rest : torch::cat(parts);
}

}  // namespace

SimilarityTransforms scaling(const ScaleChange& change) {
  return {.scales = torch::tensor({change.scale}, torch::kFloat64),
          .R = torch::eye(3, torch::kFloat64).unsqueeze(0),
          .t = ((1.0 - change.scale) * change.center).unsqueeze(0)};
}

SimilarityTransforms rigid_transforms(const Tensor& motions) {
  const Tensor rows = motions.slice(1, 0, 3);
  return {.scales = torch::ones({motions.size(0)}, torch::kFloat64),
          .R = rows.slice(2, 0, 3).contiguous(),
          .t = rows.select(2, 3).contiguous()};
}

Tensor sh_rotations(int degree, const Tensor& R) {
  // Rotated basis functions of a degree are linear combinations of that degree's basis, so the
  // matrix follows from basis values at more directions than there are coefficients.
  const Tensor directions = spread_directions(64);
  const Tensor values = sh_values(degree, directions);
  const Tensor rotated_values = sh_values(degree, torch::matmul(directions, R));
  return torch::matmul(torch::pinverse(values), rotated_values);
}

Gaussians transformed(const Gaussians& gaussians, const SimilarityTransforms& similarities,
                      const Tensor& which) {
  check(similarities);
  const torch::NoGradGuard no_grad;
  const auto options = gaussians.means.options();
  const Tensor index = which.defined()
                           ? which.to(options.device())
                           : torch::zeros({gaussians.size()}, options.dtype(torch::kInt64));
  const auto per_gaussian = [&](const Tensor& values) {
    return values.to(options.device()).index_select(0, index);
  };
  const Tensor means = gaussians.means.to(torch::kFloat64);
  Gaussians out = gaussians;
  out.means =
      ((per_gaussian(similarities.scales.view({-1, 1, 1}) * similarities.R) * means.unsqueeze(1))
           .sum(2) +
       per_gaussian(similarities.t))
          .to(options);
  out.log_scales =
      gaussians.log_scales + per_gaussian(similarities.scales.log().unsqueeze(1)).to(options);
  out.quaternions = quaternion_products(per_gaussian(quaternions_of(similarities.R)).to(options),
                                        gaussians.quaternions);
  const int degree = gaussians.sh_degree();
  if (degree > 0) {
    out.sh_rest =
        rotated(gaussians.sh_rest, sh_rotations(degree, similarities.R).to(options), index);
  }
  return out;
}

}  // namespace apvi::gaussians
