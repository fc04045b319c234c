// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/model/similarity.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <vector>

#include "gaussians/render/sh_math.hpp"
#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using test::tensors_near;
using torch::Tensor;

const auto kF64 = torch::dtype(torch::kFloat64);

Tensor random_rotation(std::uint64_t seed) {
  torch::manual_seed(seed);
  const Tensor w = torch::randn({3}, kF64);
  const auto v = w.accessor<double, 1>();
  const Tensor cross =
      torch::tensor({0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0}, kF64).reshape({3, 3});
  return torch::matrix_exp(cross);
}

/// Rotation matrices [N,3,3] of quaternions [N,4] w x y z of any length.
Tensor matrices(const Tensor& quaternions) {
  const Tensor q = quaternions / quaternions.norm(2, 1, true);
  const Tensor w = q.select(1, 0), x = q.select(1, 1), y = q.select(1, 2), z = q.select(1, 3);
  return torch::stack({1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
                       2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                       2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)},
                      1)
      .reshape({-1, 3, 3});
}

Tensor covariances(const Gaussians& g) {
  const Tensor axes = matrices(g.quaternions) * torch::exp(g.log_scales).unsqueeze(1);
  return torch::matmul(axes, axes.transpose(1, 2));
}

Gaussians make_gaussians(std::int64_t count, int degree) {
  torch::manual_seed(5);
  return {.means = torch::randn({count, 3}, kF64),
          .log_scales = torch::randn({count, 3}, kF64),
          .quaternions = torch::randn({count, 4}, kF64),
          .logit_opacities = torch::randn({count}, kF64),
          .sh_dc = torch::randn({count, 3}, kF64),
          .sh_rest = torch::randn({count, sh_rest_count(degree), 3}, kF64)};
}

SimilarityTransforms make_similarity(std::uint64_t seed) {
  return {.scales = torch::full({1}, 1.7, kF64),
          .R = random_rotation(seed).unsqueeze(0),
          .t = torch::randn({1, 3}, kF64)};
}

/// View-dependent part of a color [3] for a direction [3].
Tensor view_dependent_color(const Tensor& sh_rest, int degree, const Tensor& direction) {
  const auto d = direction.accessor<double, 1>();
  Tensor basis = torch::zeros({sh_rest_count(degree)}, kF64);
  sh_basis(degree, d[0], d[1], d[2], basis.data_ptr<double>());
  return torch::matmul(basis, sh_rest);
}

TEST(Similarity, TransformsMeansAndCovariances) {
  const Gaussians g = make_gaussians(20, 0);
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const SimilarityTransforms s = make_similarity(seed);
    const Gaussians moved = transformed(g, s);
    const Tensor R = s.R[0];
    EXPECT_TRUE(tensors_near(moved.means, 1.7 * torch::matmul(g.means, R.t()) + s.t, 1e-12));
    const Tensor expected = 1.7 * 1.7 * torch::matmul(torch::matmul(R, covariances(g)), R.t());
    EXPECT_TRUE(tensors_near(covariances(moved), expected, 1e-12)) << seed;
  }
}

TEST(Similarity, AddsLogScaleToLogScales) {
  const Gaussians g = make_gaussians(5, 0);
  const SimilarityTransforms s = make_similarity(1);
  const Tensor added = transformed(g, s).log_scales - g.log_scales;
  EXPECT_TRUE(tensors_near(added, torch::full({5, 3}, std::log(1.7), kF64), 1e-14));
}

TEST(Similarity, RotatedColorsMatchAtRotatedDirections) {
  for (int degree = 1; degree <= kMaxShDegree; ++degree) {
    const Gaussians g = make_gaussians(3, degree);
    for (std::uint64_t seed = 0; seed < 5; ++seed) {
      const SimilarityTransforms s = make_similarity(seed);
      const Gaussians moved = transformed(g, s);
      const Tensor direction = torch::nn::functional::normalize(
          torch::randn({3}, kF64), torch::nn::functional::NormalizeFuncOptions().dim(0));
      for (std::int64_t i = 0; i < 3; ++i) {
        EXPECT_TRUE(tensors_near(
            view_dependent_color(moved.sh_rest[i], degree, torch::matmul(s.R[0], direction)),
            view_dependent_color(g.sh_rest[i], degree, direction), 1e-12));
      }
    }
  }
}

TEST(Similarity, ShRotationsAreBlockDiagonalAndOrthonormal) {
  const Tensor D = sh_rotations(3, random_rotation(3).unsqueeze(0))[0];
  EXPECT_TRUE(tensors_near(torch::matmul(D, D.t()), torch::eye(15, kF64), 1e-12));
  EXPECT_LT(D.slice(0, 0, 3).slice(1, 3).abs().max().item<double>(), 1e-13);
  EXPECT_LT(D.slice(0, 3, 8).slice(1, 8).abs().max().item<double>(), 1e-13);
}

TEST(Similarity, InverseTransformRestoresGaussians) {
  const Gaussians g = make_gaussians(6, 3);
  const SimilarityTransforms s = make_similarity(2);
  const SimilarityTransforms back = {.scales = 1.0 / s.scales,
                                     .R = s.R.transpose(1, 2).contiguous(),
                                     .t = -torch::matmul(s.t, s.R[0]) / 1.7};
  const Gaussians again = transformed(transformed(g, s), back);
  EXPECT_TRUE(tensors_near(again.means, g.means, 1e-12));
  EXPECT_TRUE(tensors_near(covariances(again), covariances(g), 1e-12));
  EXPECT_TRUE(tensors_near(again.sh_rest, g.sh_rest, 1e-12));
}

TEST(Similarity, BatchMatchesSingleTransforms) {
  const Gaussians g = make_gaussians(7, 2);
  const Tensor which = torch::tensor({2, 0, 1, 1, 2, 0, 2}, torch::kInt64);
  std::vector<SimilarityTransforms> alone;
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    alone.push_back(make_similarity(seed));
    alone.back().scales += static_cast<double>(seed);
  }
  const SimilarityTransforms all = {
      .scales = torch::cat({alone[0].scales, alone[1].scales, alone[2].scales}),
      .R = torch::cat({alone[0].R, alone[1].R, alone[2].R}),
      .t = torch::cat({alone[0].t, alone[1].t, alone[2].t})};
  const Gaussians moved = transformed(g, all, which);
  for (std::int64_t i = 0; i < g.size(); ++i) {
    const auto own = static_cast<std::size_t>(which[i].item<std::int64_t>());
    const Gaussians expected = transformed(g, alone[own]);
    for (std::size_t k = 0; k < 6; ++k) {
      EXPECT_TRUE(tensors_near((*moved.tensors()[k])[i], (*expected.tensors()[k])[i], 1e-12));
    }
  }
}

TEST(Similarity, RejectsInvalidTransforms) {
  const Gaussians g = make_gaussians(2, 1);
  SimilarityTransforms s = make_similarity(1);
  s.scales[0] = 0.0;
  EXPECT_THROW(transformed(g, s), c10::Error);
  s = make_similarity(1);
  s.R = 1.1 * s.R;
  EXPECT_THROW(transformed(g, s), c10::Error);
  s.R = -torch::eye(3, kF64).unsqueeze(0);
  EXPECT_THROW(transformed(g, s), c10::Error);
}

}  // namespace
}  // namespace apvi::gaussians
