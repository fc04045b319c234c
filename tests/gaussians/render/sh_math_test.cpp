// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/render/sh_math.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <array>
#include <cmath>

#include "support/torch_raster.hpp"
#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using torch::Tensor;

Tensor directions(std::int64_t count) {
  torch::manual_seed(1);
  const Tensor d = torch::randn({count, 3}, torch::kFloat64);
  return d / d.norm(2, 1, true);
}

TEST(SphericalHarmonics, MatchReferenceExpression) {
  const Tensor d = directions(50);
  const Tensor expected = apvi::test::reference_sh(d).slice(1, 1).contiguous();
  const auto xyz = d.accessor<double, 2>();
  for (std::int64_t i = 0; i < 50; ++i) {
    std::array<double, kMaxShRest> basis = {};
    sh_basis(3, xyz[i][0], xyz[i][1], xyz[i][2], basis.data());
    for (std::int64_t k = 0; k < kMaxShRest; ++k) {
      EXPECT_NEAR(basis[static_cast<std::size_t>(k)], expected[i][k].item<double>(), 1e-13);
    }
  }
}

TEST(SphericalHarmonics, AreOrthonormalOverTheSphere) {
  // Exact quadrature: equal steps of longitude, Gauss-Legendre nodes for degree 7 in z.
  const std::array<double, 4> node = {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563,
                                      0.8611363115940526};
  const std::array<double, 4> weight = {0.3478548451374538, 0.6521451548625461, 0.6521451548625461,
                                        0.3478548451374538};
  constexpr int kSteps = 8;
  const double pi = 3.14159265358979323846;
  std::array<std::array<double, kMaxShRest>, kMaxShRest> product = {};
  for (int i = 0; i < kSteps * 4; ++i) {
    const double angle = 2 * pi * (i % kSteps + 0.3) / kSteps;
    const double z = node[static_cast<std::size_t>(i / kSteps)];
    const double r = std::sqrt(1 - z * z);
    std::array<double, kMaxShRest> b = {};
    sh_basis(3, r * std::cos(angle), r * std::sin(angle), z, b.data());
    const double w = weight[static_cast<std::size_t>(i / kSteps)] * 2 * pi / kSteps;
    for (std::size_t j = 0; j < b.size(); ++j) {
      for (std::size_t k = 0; k < b.size(); ++k) product[j][k] += w * b[j] * b[k];
    }
  }
  for (std::size_t j = 0; j < product.size(); ++j) {
    for (std::size_t k = 0; k < product.size(); ++k) {
      EXPECT_NEAR(product[j][k], j == k ? 1.0 : 0.0, 1e-12) << j << " " << k;
    }
  }
}

}  // namespace
}  // namespace apvi::gaussians
