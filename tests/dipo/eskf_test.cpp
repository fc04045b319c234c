// SPDX-License-Identifier: BSD-3-Clause
#include "dipo/eskf.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "core/random.hpp"
#include "dipo/measurements.hpp"
#include "support/spline_imu.hpp"

namespace apvi::dipo {
namespace {

using Eigen::Vector3d;

Matrix random_covariance(Random& random) {
  Matrix A;
  for (int i = 0; i < A.size(); ++i) A(i) = random.uniform(-0.1, 0.1);
  return A * A.transpose() + 1e-4 * Matrix::Identity();
}

TEST(Eskf, UpdateEqualsInformationForm) {
  Random random(31);
  State x;
  x.nav.v_body = Vector3d(0.5, 0.1, 0.0);
  const Matrix P = random_covariance(random);
  Eskf filter(x, P);
  // The residual is zero, so the reset of the error state is the identity.
  const Measurement m = pressure_depth(x, Vector3d(0.1, 0.2, 0.3), -1.0, -0.3, 0.01);
  filter.update(m);
  const Matrix expected = (P.inverse() + m.H.transpose() * m.R.inverse() * m.H).inverse();
  EXPECT_LT((filter.covariance() - expected).cwiseAbs().maxCoeff(), 1e-10);
}

TEST(Eskf, CovarianceStaysSymmetricPositiveDefiniteOverManySteps) {
  Random random(32);
  Eskf filter(State{}, 1e-2 * Matrix::Identity());
  const CalibrationRandomWalk walk{
      .time_offset = 1e-4, .scale = 1e-5, .mounting = 1e-5, .lever_arm = 1e-4, .depth_bias = 1e-3};
  const imu::EarthModel world;
  for (int i = 0; i < 5000; ++i) {
    filter.propagate(test::random_vector(random, 0.5), Vector3d(0, 0, 9.8), 0.01, world, {}, walk);
    if (i % 20 != 0) continue;
    const Kinematics k{test::random_vector(random, 0.5), Vector3d(0, 0, 9.8), Vector3d::Zero()};
    filter.update(dvl_velocity(filter.state(), k, world, test::random_vector(random, 0.01),
                               1e-4 * Eigen::Matrix3d::Identity()));
    filter.update(pressure_depth(filter.state(), Vector3d::Zero(), -1.0, 0.0, 1e-4));
  }
  const Matrix& P = filter.covariance();
  EXPECT_LT((P - P.transpose()).cwiseAbs().maxCoeff(), 1e-12 * P.cwiseAbs().maxCoeff());
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<Matrix>(P).eigenvalues().minCoeff(), -1e-12);
}

TEST(Eskf, CalibrationWithZeroVarianceStaysConstant) {
  Matrix P = Matrix::Zero();
  P.topLeftCorner<imu::kNavSize, imu::kNavSize>().diagonal().setConstant(0.1);
  Eskf filter(State{}, P);
  const imu::EarthModel world;
  for (int i = 0; i < 100; ++i) {
    filter.propagate(Vector3d(0.1, 0.0, 0.2), Vector3d(0, 0, 9.8), 0.01, world, {}, {});
    filter.update(dvl_velocity(filter.state(), {}, world, Vector3d(1.0, 0.0, 0.0),
                               1e-4 * Eigen::Matrix3d::Identity()));
  }
  EXPECT_EQ(filter.state().dvl_scale_error, 0.0);
  EXPECT_EQ(filter.state().dvl_time_offset_s, 0.0);
  EXPECT_EQ(filter.state().p_body_dvl, Vector3d::Zero());
  EXPECT_NEAR(filter.state().nav.v_body.x(), 1.0, 0.01);
}

TEST(Eskf, CloneEqualsCurrentPosition) {
  Random random(33);
  Eskf filter(State{}, random_covariance(random));
  filter.propagate(Vector3d::Zero(), Vector3d(1.0, 0, 9.8), 0.1, imu::EarthModel{}, {}, {});
  filter.clone_position();
  EXPECT_EQ(filter.state().p_last_ping, filter.state().nav.p_world);
  const Matrix& P = filter.covariance();
  const Eigen::Matrix3d apart =
      P.block<3, 3>(imu::kPosition, imu::kPosition) + P.block<3, 3>(kLastPing, kLastPing) -
      P.block<3, 3>(imu::kPosition, kLastPing) - P.block<3, 3>(kLastPing, imu::kPosition);
  EXPECT_LT(apart.norm(), 1e-12);  // the difference has zero variance
}

}  // namespace
}  // namespace apvi::dipo
