// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/degeneracy.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>

#include "fusion/random_pose.hpp"
#include "fusion/semicircle.hpp"
#include "support/matchers.hpp"

namespace apvi::fusion {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using test::MatrixNear;

// A matrix with known eigenvalues of the rotated diagonal blocks and non-zero off-diagonal blocks.
Matrix6 information(const Vector3d& rotation, const Vector3d& position) {
  const Matrix3d R = so3::exp({0.3, -0.5, 0.8}).toRotationMatrix();
  Matrix6 H = Matrix6::Zero();
  H.topLeftCorner<3, 3>() = R * rotation.asDiagonal() * R.transpose();
  H.bottomRightCorner<3, 3>() = R.transpose() * position.asDiagonal() * R;
  H.topRightCorner<3, 3>() = 0.1 * Matrix3d::Ones();
  H.bottomLeftCorner<3, 3>() = 0.1 * Matrix3d::Ones();
  return H;
}

TEST(Eigenvalues, AreThoseOfTheDiagonalBlocks) {
  const Eigenvalues e = block_eigenvalues(information({900.0, 100.0, 400.0}, {7.0, 5.0, 6.0}));
  EXPECT_THAT(e.rotation, MatrixNear(Vector3d(100.0, 400.0, 900.0), 1e-9));
  EXPECT_THAT(e.position, MatrixNear(Vector3d(5.0, 6.0, 7.0), 1e-12));
}

TEST(Eigenvalues, PerInlierDividesByTheNumberOfInliers) {
  const Eigenvalues e{Vector3d(100.0, 200.0, 300.0), Vector3d(1.0, 2.0, 3.0)};
  EXPECT_THAT(per_inlier(e, 50).rotation, MatrixNear(Vector3d(2.0, 4.0, 6.0), 1e-15));
  EXPECT_THAT(per_inlier(e, 50).position, MatrixNear(Vector3d(0.02, 0.04, 0.06), 1e-15));
  EXPECT_THAT(per_inlier(e, 0).rotation, MatrixNear(e.rotation, 0.0));
}

TEST(Remapping, KeepsAllDirectionsOfAWellConditionedProblem) {
  const WellConditioned all =
      well_conditioned(information({900.0, 100.0, 400.0}, {7.0, 5.0, 6.0}), {100.0 - 1e-9, 4.0});
  EXPECT_EQ(all.directions(), 6);
  EXPECT_THAT(all.projection, MatrixNear(Matrix6::Identity(), 1e-12));
}

TEST(Remapping, MatchesThePapersEigenvectorProduct) {
  const Matrix6 H = information({900.0, 100.0, 400.0}, {7.0, 5.0, 6.0});
  const WellConditioned kept = well_conditioned(H, {200.0, 5.5});
  ASSERT_EQ(kept.directions(), 4);
  // V_f has eigenvectors as rows, V_u the same with the degenerate ones zeroed.
  Matrix6 V_f = Matrix6::Zero();
  Matrix6 V_u = Matrix6::Zero();
  for (const int at : {0, 3}) {
    const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(Matrix3d(H.block<3, 3>(at, at)));
    V_f.block<3, 3>(at, at) = solver.eigenvectors().transpose();
    V_u.block<3, 3>(at, at) = solver.eigenvectors().transpose();
    V_u.row(at).setZero();  // eigenvalues are ascending
  }
  EXPECT_THAT(kept.projection, MatrixNear(V_f.inverse() * V_u, 1e-12));
  EXPECT_THAT(kept.projection, MatrixNear(kept.basis * kept.basis.transpose(), 1e-12));
}

TEST(Remapping, RemovesOnlyTheDegenerateDirection) {
  const Vector3d weak = Vector3d(1.0, 2.0, 2.0) / 3.0;
  const Vector3d strong = Vector3d(2.0, 1.0, -2.0) / 3.0;
  Matrix6 H = 1e4 * Matrix6::Identity();
  H.bottomRightCorner<3, 3>() -= (1e4 - 1.0) * weak * weak.transpose();
  const WellConditioned kept = well_conditioned(H, {100.0, 100.0});
  ASSERT_EQ(kept.directions(), 5);
  Vector6 step;
  step << 0.01, 0.02, 0.03, 0.5 * weak + 0.2 * strong;
  Vector6 expected;
  expected << 0.01, 0.02, 0.03, 0.2 * strong;
  EXPECT_THAT(Vector6(kept.projection * step), MatrixNear(expected, 1e-12));
}

TEST(Remapping, EigenvalueAtTheThresholdIsKept) {
  const Matrix6 H = Matrix6::Identity() * 64.0;
  EXPECT_EQ(well_conditioned(H, {64.0, 64.0}).directions(), 6);
  EXPECT_EQ(well_conditioned(H, {std::nextafter(64.0, 65.0), 64.0}).directions(), 3);
  EXPECT_EQ(well_conditioned(H, {65.0, 65.0}).directions(), 0);
}

TEST(Semicircle, LowerEdgeMatchesTheFormula) {
  EXPECT_DOUBLE_EQ(wigner_lower_edge(10.0, 0.5, 9), 7.0);
}

TEST(Semicircle, CdfHasKnownValues) {
  EXPECT_DOUBLE_EQ(semicircle_cdf(3.0, 3.0, 2.0), 0.5);
  EXPECT_DOUBLE_EQ(semicircle_cdf(1.0, 3.0, 2.0), 0.0);
  EXPECT_DOUBLE_EQ(semicircle_cdf(9.0, 3.0, 2.0), 1.0);
  // 1/2 + (sqrt(3)/4 + π/6)/π at half the radius.
  EXPECT_NEAR(semicircle_cdf(4.0, 3.0, 2.0), 0.8044988905, 1e-9);
}

// Quantiles of a semicircle, by bisection.
std::vector<double> semicircle_quantiles(double mean, double radius, int count) {
  std::vector<double> values;
  for (int i = 0; i < count; ++i) {
    double low = mean - radius;
    double high = mean + radius;
    for (int k = 0; k < 60; ++k) {
      const double x = 0.5 * (low + high);
      (semicircle_cdf(x, mean, radius) < (i + 0.5) / count ? low : high) = x;
    }
    values.push_back(0.5 * (low + high));
  }
  return values;
}

TEST(Semicircle, FitRecoversTheEdgeOfSemicircleSamples) {
  const auto fit = fit_semicircle(semicircle_quantiles(50.0, 20.0, 2000), false);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->mean, 50.0, 1e-6);
  EXPECT_NEAR(fit->lower_edge, 30.0, 0.02);
  EXPECT_LT(fit->misfit, 1e-3);
  EXPECT_EQ(fit->share_below, 0.0);
  EXPECT_EQ(fit->count, 2000U);
}

TEST(Semicircle, FitRecoversTheEdgeOfARandomSymmetricMatrix) {
  constexpr int kSize = 300;
  constexpr double kSigma = 0.4;
  Random random(5);
  Eigen::MatrixXd A(kSize, kSize);
  for (int i = 0; i < kSize; ++i) {
    for (int k = 0; k <= i; ++k) A(i, k) = A(k, i) = random.normal(0.0, kSigma);
  }
  A.diagonal().array() += 100.0;
  const Eigen::VectorXd values =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(A, Eigen::EigenvaluesOnly).eigenvalues();
  const auto fit = fit_semicircle({values.begin(), values.end()}, false);
  ASSERT_TRUE(fit);
  const double edge = wigner_lower_edge(100.0, kSigma, kSize);  // 86.14
  EXPECT_NEAR(fit->lower_edge, edge, 0.02 * (100.0 - edge));
  EXPECT_LT(fit->misfit, 0.02);
}

TEST(Semicircle, FitsLogarithmsOfValuesThatSpanDecades) {
  std::vector<Eigenvalues> samples;
  for (const double x : semicircle_quantiles(4.0, 1.5, 999)) {
    const double value = std::pow(10.0, x);
    samples.push_back({Vector3d::Constant(value), Vector3d::Constant(1e-3 * value)});
  }
  const auto fit = fit_semicircle(samples);
  ASSERT_TRUE(fit);
  EXPECT_TRUE(fit->rotation.logarithmic);
  EXPECT_NEAR(std::log10(fit->thresholds().rotation), 2.5, 0.01);
  EXPECT_NEAR(std::log10(fit->thresholds().position), -0.5, 0.01);
  EXPECT_EQ(fit->rotation.count, 3U * 999U);
  // The linear fit has a negative edge that rejects nothing.
  std::vector<double> plain;
  for (const Eigenvalues& e : samples) plain.push_back(e.rotation(0));
  EXPECT_LT(fit_semicircle(plain, false)->lower_edge, 0.0);
}

TEST(Semicircle, FitNeedsTwoDistinctValues) {
  EXPECT_FALSE(fit_semicircle(std::vector<double>{}, false));
  EXPECT_FALSE(fit_semicircle(std::vector<double>{3.0, 3.0, 3.0}, false));
  EXPECT_FALSE(fit_semicircle(std::vector<double>{-1.0, 0.0, 2.0}, true));
  const auto fit = fit_semicircle(std::vector<double>{1.0, NAN, 3.0, INFINITY}, false);
  ASSERT_TRUE(fit);
  EXPECT_EQ(fit->count, 2U);
}

}  // namespace
}  // namespace apvi::fusion
