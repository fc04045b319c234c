// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/robust_normals.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

namespace apvi::mapping {
namespace {

using torch::Tensor;
using torch::nn::functional::normalize;

const auto kF64 = torch::dtype(torch::kFloat64);

double worst_angle_deg(const Tensor& a, const Tensor& b) {
  return (a * b).sum(1).clamp(-1.0, 1.0).acos().max().item<double>() * 180.0 / M_PI;
}

/// Points [n,3] on a square of 2 m.
Tensor square(std::int64_t n) {
  const Tensor points = 2.0 * torch::rand({n, 3}, kF64);
  points.select(1, 2).zero_();
  return points;
}

TEST(RobustNormals, IgnoreOutlierViews) {
  torch::manual_seed(5);
  const Tensor points = square(600);
  const Tensor truth = torch::tensor({0.0, 0.0, 1.0}, kF64).expand({600, 3});
  Tensor normals = normalize(truth + 0.1 * torch::randn({600, 3}, kF64));
  // One view in five has a consistent depth step.
  normals.slice(0, 0, 120).copy_(
      normalize(torch::tensor({1.0, 0.0, 0.3}, kF64) + 0.1 * torch::randn({120, 3}, kF64)));
  EXPECT_LT(worst_angle_deg(robust_normals(points, normals, 1.0), truth), 3.0);
  const Tensor mean = normalize(normals.mean(0, true));
  EXPECT_GT(worst_angle_deg(mean, truth.slice(0, 0, 1)), 8.0);
}

TEST(RobustNormals, FollowACurvedSurface) {
  torch::manual_seed(6);
  const Tensor points = square(900);
  const Tensor slope = points.select(1, 0).sub(1.0).mul(0.4);
  const Tensor normals =
      normalize(torch::stack({slope, torch::zeros_like(slope), torch::ones_like(slope)}, 1));
  EXPECT_LT(worst_angle_deg(robust_normals(points, normals, 0.2), normals), 6.0);
}

TEST(RobustNormals, KeepTheNormalOfAnIsolatedPoint) {
  const Tensor points = torch::tensor({0.0, 0.0, 0.0, 9.0, 0.0, 0.0}, kF64).reshape({2, 3});
  const Tensor normals = torch::tensor({0.0, 0.6, 0.8, 1.0, 0.0, 0.0}, kF64).reshape({2, 3});
  EXPECT_TRUE(torch::allclose(robust_normals(points, normals, 1.0), normals));
  EXPECT_EQ(robust_normals(points.slice(0, 0, 0), normals.slice(0, 0, 0), 1.0).size(0), 0);
}

}  // namespace
}  // namespace apvi::mapping
