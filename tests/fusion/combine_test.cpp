// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/combine.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "fusion/random_pose.hpp"
#include "support/matchers.hpp"

namespace apvi::fusion {
namespace {

using test::MatrixNear;
using test::PoseNear;

TEST(PoseEstimate, BoxplusInvertsBoxminus) {
  Random random(1);
  for (int i = 0; i < 20; ++i) {
    const SE3 a = test::random_pose(random);
    const SE3 b = test::random_pose(random);
    EXPECT_THAT(boxplus(b, boxminus(a, b)), PoseNear(a, 1e-12));
  }
}

TEST(Eq7, MatchesThePrintedGainForInvertibleInformation) {
  Random random(2);
  const PoseEstimate dipo{test::random_pose(random), test::random_covariance(random, 0.02, 0.2)};
  const Matrix6 V = test::random_covariance(random, 0.01, 0.1);
  const SE3 vio = boxplus(dipo.T_world_body, 0.1 * test::normal6(random));
  const PoseEstimate fused = fuse_independent(dipo, vio, V.inverse());
  const Matrix6 K = dipo.covariance * (dipo.covariance + V).inverse();
  EXPECT_THAT(fused.T_world_body,
              PoseNear(boxplus(dipo.T_world_body, K * boxminus(vio, dipo.T_world_body)), 1e-9));
  EXPECT_THAT(fused.covariance, MatrixNear((Matrix6::Identity() - K) * dipo.covariance, 1e-9));
}

TEST(Eq7, EqualCovariancesGiveTheMidpoint) {
  const PoseEstimate dipo{SE3{}, test::diagonal(1.0, 0.1)};
  const SE3 vio{so3::exp({0.0, 0.0, 0.02}), {0.2, 0.0, -0.1}};
  const PoseEstimate fused = fuse_independent(dipo, vio, dipo.covariance.inverse());
  EXPECT_THAT(fused.T_world_body,
              PoseNear(SE3{so3::exp({0.0, 0.0, 0.01}), {0.1, 0.0, -0.05}}, 1e-12));
}

TEST(Eq7, DirectionsWithoutInformationKeepDipo) {
  const PoseEstimate dipo{SE3{}, test::diagonal(1.0, 0.1)};
  const SE3 vio{so3::exp({0.0, 0.0, 0.02}), {5.0, 0.3, 0.0}};
  Matrix6 information = Matrix6::Zero();
  information(4, 4) = 1e12;  // y position only
  const PoseEstimate fused = fuse_independent(dipo, vio, information);
  EXPECT_THAT(fused.T_world_body, PoseNear(SE3{{1, 0, 0, 0}, {0.0, 0.3, 0.0}}, 1e-8));
  EXPECT_NEAR(fused.covariance(3, 3), 0.01, 1e-12);
}

TEST(CovarianceIntersection, ReturnsTheBetterEstimateIfItDominates) {
  const PoseEstimate dipo{SE3{}, test::diagonal(1.0, 0.1)};
  const SE3 vio{so3::exp({0.0, 0.0, 0.02}), {0.2, 0.0, 0.0}};
  const CovarianceIntersection worse =
      intersect_covariances(dipo, vio, test::diagonal(2.0, 0.2).inverse());
  EXPECT_EQ(worse.weight, 1.0);
  EXPECT_THAT(worse.estimate.T_world_body, PoseNear(dipo.T_world_body, 1e-12));
  const CovarianceIntersection better =
      intersect_covariances(dipo, vio, test::diagonal(0.5, 0.05).inverse());
  EXPECT_EQ(better.weight, 0.0);
  EXPECT_THAT(better.estimate.T_world_body, PoseNear(vio, 1e-12));
}

TEST(CovarianceIntersection, MirroredCovariancesGetEqualWeights) {
  Vector6 first;
  first << 1e-4, 1e-4, 1e-4, 1.0, 1.0, 0.01;
  Vector6 second;
  second << 1e-4, 1e-4, 1e-4, 0.01, 1.0, 1.0;
  const PoseEstimate dipo{SE3{}, first.asDiagonal()};
  const CovarianceIntersection result =
      intersect_covariances(dipo, SE3{}, second.cwiseInverse().asDiagonal());
  EXPECT_NEAR(result.weight, 0.5, 1e-6);
  // Information (1 + 100) / 2 in the two directions that differ.
  EXPECT_NEAR(result.estimate.covariance(3, 3), 2.0 / 101.0, 1e-6);
  EXPECT_NEAR(result.estimate.covariance(4, 4), 1.0, 1e-9);
}

TEST(CovarianceIntersection, IsConsistentForFullyCorrelatedErrors) {
  // P_ci is an upper bound for every correlation; the worst are fully correlated pairs.
  Random random(3);
  for (int i = 0; i < 50; ++i) {
    const PoseEstimate dipo{SE3{}, test::random_covariance(random, 0.02, 0.2)};
    const Matrix6 V = test::random_covariance(random, 0.02, 0.2);
    const CovarianceIntersection result = intersect_covariances(dipo, SE3{}, V.inverse());
    const Matrix6& P = result.estimate.covariance;
    // The gains, and the error covariance if the VIO error is L_v L_d^-1 times the DIPO error.
    const Matrix6 W = (1.0 - result.weight) * P * V.inverse();
    const Matrix6 T =
        Matrix6(V.llt().matrixL()) * Matrix6(dipo.covariance.llt().matrixL()).inverse();
    const Matrix6 M = Matrix6::Identity() - W + W * T;
    const Matrix6 actual = M * dipo.covariance * M.transpose();
    const Eigen::LDLT<Matrix6> ldlt(P - actual + 1e-12 * Matrix6::Identity());
    EXPECT_TRUE(ldlt.isPositive()) << i;
  }
}

}  // namespace
}  // namespace apvi::fusion
