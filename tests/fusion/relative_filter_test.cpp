// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/relative_filter.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <optional>

#include "fusion/two_odometries.hpp"
#include "support/matchers.hpp"

namespace apvi::fusion {
namespace {

using test::MatrixNear;
using test::PoseNear;

Stamp at(double seconds) {
  return Stamp{} + Duration::from_seconds(seconds);
}

TEST(ErrorTransition, PropagatesHeadingErrorToPosition) {
  const SE3 before{so3::exp({0.2, -0.1, 0.9}), {1.0, 2.0, 3.0}};
  const SE3 motion{so3::exp({0.1, 0.2, -0.3}), {0.7, 0.1, -0.2}};
  const SE3 now = before * motion;
  const Matrix6 A = error_transition(before, now);
  for (int i = 0; i < 6; ++i) {
    const Vector6 error = 1e-6 * Vector6::Unit(i);
    const Vector6 carried = boxminus(boxplus(before, error) * motion, now);
    EXPECT_THAT(carried, MatrixNear(A * error, 1e-11)) << i;
  }
}

TEST(RandomWalkEstimator, EstimatesTheNoiseOfASimulatedOdometry) {
  const test::TwoOdometries setup;
  RandomWalkEstimator walk(2.0, 1e-6, 1e-6);
  std::optional<PoseEstimate> before;
  double rotation = 0.0;
  double position = 0.0;
  int count = 0;
  for (const auto& frame : setup.run(7, 60.0, {})) {
    if (before) walk.add(*before, frame.dipo, setup.dt);
    before = frame.dipo;
    if (frame.t < 10.0) continue;
    rotation += std::sqrt(walk.noise(1.0)(0, 0)) / kRadiansPerDegree;
    position += std::sqrt(walk.noise(1.0)(5, 5));
    ++count;
  }
  EXPECT_NEAR(rotation / count, setup.dipo_rotation_deg, 0.1 * setup.dipo_rotation_deg);
  EXPECT_NEAR(position / count, setup.dipo_position, 0.1 * setup.dipo_position);
}

TEST(RandomWalkEstimator, RespectsTheLowerBounds) {
  RandomWalkEstimator walk(2.0, 1e-3, 2e-3);
  walk.add({SE3{}, test::diagonal(1.0, 0.1)}, {SE3{}, test::diagonal(0.5, 0.05)}, 0.1);
  EXPECT_NEAR(walk.noise(0.5)(2, 2), 0.5e-6, 1e-15);
  EXPECT_NEAR(walk.noise(0.5)(3, 3), 2e-6, 1e-15);
}

TEST(TiltHeightCorrection, MatchesTheKalmanUpdate) {
  Random random(1);
  const SE3 pose = test::random_pose(random);
  const Matrix6 P = test::random_covariance(random, 0.02, 0.2);
  Eigen::Matrix<double, 3, 6> H = Eigen::Matrix<double, 3, 6>::Zero();
  H.topLeftCorner<2, 3>() = pose.rotation.toRotationMatrix().topRows<2>();
  H(2, 5) = 1.0;
  const Eigen::Matrix3d R = Eigen::Vector3d(1e-4, 2e-4, 4e-3).asDiagonal();
  const Eigen::Matrix<double, 6, 3> K =
      P * H.transpose() * Eigen::Matrix3d(H * P * H.transpose() + R).inverse();
  const Matrix6 G = Matrix6::Identity() - K * H;
  const TiltHeightCorrection correction = tilt_height_correction(pose, P, G * P);
  EXPECT_THAT(correction.G, MatrixNear(G, 1e-9));
  EXPECT_THAT(correction.N, MatrixNear(K * R * K.transpose(), 1e-9));
}

TEST(TiltHeightCorrection, IsTheIdentityWithoutMeasurements) {
  const Matrix6 P = test::diagonal(1.0, 0.1);
  const TiltHeightCorrection correction = tilt_height_correction(SE3{}, P, 1.1 * P);
  EXPECT_THAT(correction.G, MatrixNear(Matrix6::Identity(), 1e-12));
  EXPECT_THAT(correction.N, MatrixNear(Matrix6::Zero(), 1e-12));
}

TEST(RelativeFilter, EqualsDipoWithoutVio) {
  RelativeFilter filter({});
  for (const auto& frame : test::TwoOdometries{}.run(3, 20.0, {})) {
    filter.step(at(frame.t), frame.dipo, std::nullopt);
    EXPECT_THAT(filter.estimate().T_world_body, PoseNear(frame.dipo.T_world_body, 1e-12));
    EXPECT_LT(std::abs(std::log(filter.estimate().covariance.determinant() /
                                frame.dipo.covariance.determinant())),
              0.5);
  }
}

TEST(RelativeFilter, InitialVioPoseAddsNoInformation) {
  RelativeFilter filter({});
  const PoseEstimate dipo{SE3{}, test::diagonal(1.0, 0.1)};
  filter.step(at(0.0), dipo, std::nullopt);
  const PoseEstimate vio{{so3::exp({0.0, 0.1, 0.1}), {0.2, 0.2, 0.0}}, test::diagonal(0.1, 0.01)};
  filter.step(at(0.1), dipo, RelativeFilter::VioPose{vio, {}, {}});
  EXPECT_THAT(filter.estimate().T_world_body, PoseNear(dipo.T_world_body, 1e-12));
  EXPECT_FALSE(filter.nis());
}

/// Whether the NIS gate rejected VIO in the newest frame.
bool is_rejected(const RelativeFilter& filter) {
  return filter.nis().value_or(0.0) > RelativeConfig{}.nis_gate;
}

TEST(RelativeFilter, FollowsTheBetterOdometryInADifferentWorldFrame) {
  // DIPO drifts sideways by 2 cm/s with a matching covariance; the world of VIO is 1 m and 30
  // degrees away.
  RelativeFilter filter({});
  const SE3 offset{so3::exp({0.0, 0.0, 0.5}), {1.0, -1.0, 0.0}};
  PoseEstimate dipo{SE3{}, test::diagonal(0.5, 0.01)};
  for (int i = 0; i <= 100; ++i) {
    const double t = 0.1 * i;
    const SE3 truth{Eigen::Quaterniond::Identity(), {0.5 * t, 0.0, 0.0}};
    dipo.T_world_body = truth;
    dipo.T_world_body.translation.y() += 0.02 * t;
    dipo.covariance = test::diagonal(0.5, std::hypot(0.01, 0.03 * std::sqrt(t)));
    const PoseEstimate vio{offset * truth, test::diagonal(0.5, 0.1)};
    filter.step(at(t), dipo, RelativeFilter::VioPose{vio, 0.01 * test::diagonal(0.1, 0.01), {}});
    EXPECT_FALSE(is_rejected(filter)) << t;
  }
  EXPECT_NEAR(filter.estimate().T_world_body.translation.y(), 0.0, 0.05);  // 0.2 for DIPO
}

TEST(RelativeFilter, KeepsTheCorrectionWithoutVio) {
  RelativeFilter filter({});
  const auto frames = test::TwoOdometries{.dipo_rotation_deg = 0.3}.run(4, 60.0, {{10.0, 40.0}});
  Vector6 learned = Vector6::Zero();
  for (const auto& frame : frames) {
    std::optional<RelativeFilter::VioPose> seen;
    if (frame.vio) seen = {*frame.vio, {}, {}};
    filter.step(at(frame.t), frame.dipo, seen);
    const Vector6 correction = boxminus(filter.estimate().T_world_body, frame.dipo.T_world_body);
    // No jump between frames, including the one in which VIO is lost.
    EXPECT_LT((correction - learned).tail<3>().norm(), 0.05) << frame.t;
    learned = correction;
  }
  EXPECT_GT(learned.tail<3>().norm(), 0.01);
}

TEST(RelativeFilter, HeightCorrectionShrinksWithDipoHeightMeasurements) {
  // DIPO's height variance shrinks between two frames; its error shrinks accordingly.
  RelativeFilter filter({});
  PoseEstimate dipo{SE3{}, test::diagonal(0.5, 0.3)};
  const Matrix6 walk = 0.01 * test::diagonal(0.1, 0.01);
  filter.step(at(0.0), dipo, RelativeFilter::VioPose{dipo, walk, {}});
  dipo.covariance = test::diagonal(0.5, 0.4);
  PoseEstimate vio = dipo;
  vio.T_world_body.translation.z() = 0.2;
  filter.step(at(0.1), dipo, RelativeFilter::VioPose{vio, walk, {}});
  EXPECT_NEAR(filter.estimate().T_world_body.translation.z(), 0.2, 0.01);
  dipo.covariance(5, 5) = 1e-4;
  filter.step(at(0.2), dipo, std::nullopt);
  EXPECT_NEAR(filter.estimate().T_world_body.translation.z(), 0.0, 0.01);
  EXPECT_NEAR(filter.estimate().T_world_body.translation.x(), 0.0, 0.01);
}

TEST(RelativeFilter, RejectsAJumpOfVio) {
  RelativeFilter filter({});
  const auto frames = test::TwoOdometries{}.run(5, 40.0, {{5.0, 100.0}});
  const Eigen::Vector3d jump(0.25, 0.0, 0.0);
  int rejected = 0;
  for (const auto& frame : frames) {
    PoseEstimate vio = frame.vio.value_or(frame.dipo);
    if (frame.t > 20.0) vio.T_world_body.translation += jump;
    std::optional<RelativeFilter::VioPose> seen;
    if (frame.vio) seen = {vio, {}, {}};
    filter.step(at(frame.t), frame.dipo, seen);
    rejected += is_rejected(filter) ? 1 : 0;
    EXPECT_LT(boxminus(filter.estimate().T_world_body, frame.truth).tail<3>().norm(), 0.25);
  }
  EXPECT_EQ(rejected, 1);
}

TEST(RelativeFilter, UsesOnlyTheGivenDirections) {
  RelativeFilter filter({});
  PoseEstimate dipo{SE3{}, test::diagonal(0.5, 0.1)};
  const Matrix6 walk = 0.01 * test::diagonal(0.1, 0.01);
  WellConditioned all;
  WellConditioned no_x;
  no_x.basis = Matrix6::Identity().rightCols<5>();
  no_x.basis.leftCols<3>() = Matrix6::Identity().leftCols<3>();
  no_x.basis.rightCols<2>() = Matrix6::Identity().rightCols<2>();
  filter.step(at(0.0), dipo, RelativeFilter::VioPose{dipo, walk, all});
  dipo.covariance = test::diagonal(0.5, 0.3);
  PoseEstimate vio = dipo;
  vio.T_world_body.translation = {0.1, 0.1, 0.0};
  filter.step(at(0.1), dipo, RelativeFilter::VioPose{vio, walk, no_x});
  EXPECT_NEAR(filter.estimate().T_world_body.translation.x(), 0.0, 1e-3);
  EXPECT_NEAR(filter.estimate().T_world_body.translation.y(), 0.1, 1e-2);
}

}  // namespace
}  // namespace apvi::fusion
