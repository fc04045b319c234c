// SPDX-License-Identifier: BSD-3-Clause
#include "gaussians/detail/merging.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

#include "gaussians/model/quaternions.hpp"
#include "gaussians/render/render_scene.hpp"
#include "support/torch_reference.hpp"

namespace apvi::gaussians {
namespace {

using apvi::test::tensors_near;
using torch::Tensor;

constexpr double kSigma_m = 0.1;

/// Two equal spheres at x = -0.3 and 0.3 m, of opacity 1/2, without view dependence.
Gaussians two_spheres() {
  const auto f64 = torch::dtype(torch::kFloat64);
  Gaussians g = Gaussians::empty(0, f64);
  g.means = torch::tensor({{-0.3, 1.0, 2.0}, {0.3, 1.0, 2.0}}, f64);
  g.log_scales = torch::full({2, 3}, std::log(kSigma_m), f64);
  g.quaternions = torch::tensor({{1.0, 0.0, 0.0, 0.0}, {0.5, 0.5, 0.5, 0.5}}, f64);
  g.logit_opacities = torch::zeros({2}, f64);
  g.sh_dc = torch::tensor({{1.0, 0.0, 0.5}, {0.0, 1.0, 0.5}}, f64);
  g.sh_rest = torch::zeros({2, 0, 3}, f64);
  return g;
}

Tensor one_group(std::int64_t size) {
  return torch::zeros({size}, torch::kInt64);
}

Tensor covariance(const Gaussians& g) {
  const Tensor axes = rotations_of(g.quaternions) * g.log_scales.exp().unsqueeze(1);
  return torch::matmul(axes, axes.transpose(1, 2));
}

/// Optical depth at the center times the area of the largest cross-section.
Tensor absorbed(const Gaussians& g) {
  const Tensor sigmas = std::get<0>(g.log_scales.exp().sort(1));
  const Tensor depth = -torch::log1p(-g.logit_opacities.sigmoid());
  return depth * sigmas.select(1, 1) * sigmas.select(1, 2);
}

TEST(Merged, HasTheMomentsOfTwoSpheres) {
  const Gaussians out = merged(two_spheres(), one_group(2), 1);
  ASSERT_EQ(out.size(), 1);
  const auto f64 = torch::dtype(torch::kFloat64);
  EXPECT_TRUE(tensors_near(out.means, torch::tensor({{0.0, 1.0, 2.0}}, f64), 1e-12));
  const double own = kSigma_m * kSigma_m;
  EXPECT_TRUE(tensors_near(covariance(out)[0],
                           torch::diag(torch::tensor({own + 0.09, own, own}, f64)), 1e-9));
  EXPECT_TRUE(tensors_near(out.sh_dc, torch::tensor({{0.5, 0.5, 0.5}}, f64), 1e-12));
}

TEST(Merged, AbsorbsAsMuchLightAsItsGroup) {
  const Gaussians g = test::make_gaussians(50);
  const Gaussians out = merged(g, one_group(50), 1);
  EXPECT_TRUE(tensors_near(absorbed(out), absorbed(g).sum().unsqueeze(0), 1e-9));
}

TEST(Merged, IsTheGaussianItselfInAGroupOfEqualOnes) {
  const Gaussians one = test::make_gaussians(1);
  Gaussians three = one;
  for (Tensor* tensor : three.tensors()) *tensor = torch::cat({*tensor, *tensor, *tensor});
  const Gaussians out = merged(three, one_group(3), 1);
  EXPECT_TRUE(tensors_near(out.means, one.means, 1e-12));
  EXPECT_TRUE(tensors_near(covariance(out), covariance(one), 1e-9));
  EXPECT_TRUE(tensors_near(out.sh_rest, one.sh_rest, 1e-12));
  EXPECT_TRUE(tensors_near(absorbed(out), 3.0 * absorbed(one), 1e-9));
}

TEST(Merged, KeepsGroupsApart) {
  const Gaussians g = test::make_gaussians(6);
  const Tensor group = torch::tensor({0, 1, 0, 1, 0, 1}, torch::kInt64);
  const Gaussians out = merged(g, group, 2);
  ASSERT_EQ(out.size(), 2);
  const Tensor rows = torch::tensor({0, 2, 4}, torch::kInt64);
  Gaussians first = g;
  for (Tensor* tensor : first.tensors()) *tensor = tensor->index_select(0, rows);
  const Gaussians alone = merged(first, one_group(3), 1);
  EXPECT_TRUE(tensors_near(out.means[0], alone.means[0], 1e-12));
  EXPECT_TRUE(tensors_near(covariance(out)[0], covariance(alone)[0], 1e-9));
  EXPECT_TRUE(tensors_near(out.logit_opacities[0], alone.logit_opacities[0], 1e-9));
}

TEST(Merged, OfOpaqueGaussiansIsOpaqueAndFinite) {
  Gaussians g = two_spheres();
  g.logit_opacities.fill_(std::numeric_limits<double>::infinity());
  const Gaussians out = merged(g, one_group(2), 1);
  EXPECT_TRUE(torch::isfinite(out.logit_opacities).all().item<bool>());
  EXPECT_GT(out.logit_opacities.sigmoid().item<double>(), 0.95);
}

}  // namespace
}  // namespace apvi::gaussians
