// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/spline.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "apvi/core/error.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"

namespace apvi {
namespace {

using Eigen::Vector3d;
using test::MatrixNear;
using test::PoseNear;
using test::RotationNear;

constexpr Duration kPeriod{100'000'000};
constexpr Stamp kStart{7'000'000'000};

Vector3d random_vector(Random& random, double sigma) {
  return {random.normal(0, sigma), random.normal(0, sigma), random.normal(0, sigma)};
}

// Rotates by up to about 0.3 rad between control poses, far more than a vehicle does.
Se3Spline aggressive_spline() {
  Random random(42);
  std::vector<SE3> control;
  SE3 pose;
  for (int i = 0; i < 20; ++i) {
    pose = pose * SE3{so3::exp(random_vector(random, 0.15)), random_vector(random, 0.2)};
    control.push_back(pose);
  }
  return {kStart, kPeriod, control};
}

std::vector<Stamp> sample_stamps(const Se3Spline& spline) {
  std::vector<Stamp> stamps;
  for (double t = 0.013; kStart + Duration::from_seconds(t + 0.01) < spline.end(); t += 0.0737) {
    stamps.push_back(kStart + Duration::from_seconds(t));
  }
  return stamps;
}

// Central difference of a vector quantity of the motion.
template <typename F>
Vector3d difference(const Se3Spline& spline, Stamp stamp, const F& quantity) {
  constexpr Duration kStep{100'000};
  return (quantity(spline.at(stamp + kStep)) - quantity(spline.at(stamp - kStep))) /
         (2.0 * kStep.seconds());
}

TEST(Spline, VelocityAndAccelerationAreDerivativesOfPosition) {
  const Se3Spline spline = aggressive_spline();
  for (const Stamp t : sample_stamps(spline)) {
    const Motion m = spline.at(t);
    const auto position = [](const Motion& x) { return x.T_world_body.translation; };
    const auto velocity = [](const Motion& x) { return x.velocity_world; };
    EXPECT_THAT(m.velocity_world, MatrixNear(difference(spline, t, position), 1e-4));
    EXPECT_THAT(m.acceleration_world, MatrixNear(difference(spline, t, velocity), 1e-3));
  }
}

TEST(Spline, AngularRatesAreDerivativesOfRotation) {
  const Se3Spline spline = aggressive_spline();
  for (const Stamp t : sample_stamps(spline)) {
    const Motion m = spline.at(t);
    const auto turned = [&](const Motion& x) {
      return so3::log(m.T_world_body.rotation.conjugate() * x.T_world_body.rotation);
    };
    const auto rate = [](const Motion& x) { return x.angular_velocity_body; };
    EXPECT_THAT(m.angular_velocity_body, MatrixNear(difference(spline, t, turned), 1e-4));
    EXPECT_THAT(m.angular_acceleration_body, MatrixNear(difference(spline, t, rate), 1e-3));
  }
}

TEST(Spline, IsContinuousAtKnots) {
  const Se3Spline spline = aggressive_spline();
  for (int i = 1; i < 14; ++i) {
    const Stamp knot = kStart + Duration{i * kPeriod.ns};
    const Motion before = spline.at(knot - Duration{1});
    const Motion after = spline.at(knot);
    EXPECT_THAT(after.T_world_body, PoseNear(before.T_world_body, 1e-7));
    EXPECT_THAT(after.acceleration_world, MatrixNear(before.acceleration_world, 1e-5));
    EXPECT_THAT(after.angular_acceleration_body,
                MatrixNear(before.angular_acceleration_body, 1e-5));
  }
}

TEST(Spline, ReproducesConstantVelocityAndRate) {
  std::vector<SE3> control;
  for (int i = 0; i < 10; ++i) {
    control.push_back({so3::exp(Vector3d(0, 0, 0.1 * i)), Vector3d(0.2 * i, -0.1 * i, 0.0)});
  }
  const Se3Spline spline(kStart, kPeriod, control);
  for (const Stamp t : sample_stamps(spline)) {
    const Motion m = spline.at(t);
    EXPECT_THAT(m.velocity_world, MatrixNear(Vector3d(2.0, -1.0, 0.0), 1e-12));
    EXPECT_THAT(m.acceleration_world, MatrixNear(Vector3d::Zero(), 1e-10));
    EXPECT_THAT(m.angular_velocity_body, MatrixNear(Vector3d(0, 0, 1.0), 1e-12));
    EXPECT_THAT(m.angular_acceleration_body, MatrixNear(Vector3d::Zero(), 1e-10));
  }
}

Trajectory figure_of_eight() {
  Trajectory t;
  for (int i = 0; i <= 60; ++i) {
    const double s = 0.1 * i;
    t.poses.push_back({kStart + Duration{i * kPeriod.ns},
                       {so3::exp(Vector3d(0.1 * std::sin(s), 0.2, s)),
                        Vector3d(3.0 * std::sin(s), 2.0 * std::sin(2.0 * s), 0.1 * s)}});
  }
  return t;
}

TEST(Spline, InterpolatesTrajectoryPoses) {
  const Trajectory t = figure_of_eight();
  const Se3Spline spline = Se3Spline::through(t, kPeriod);
  EXPECT_EQ(spline.start(), t.poses.front().stamp);
  EXPECT_GE(spline.end(), t.poses.back().stamp);
  for (const StampedPose& pose : t.poses) {
    EXPECT_THAT(spline.at(pose.stamp).T_world_body, PoseNear(pose.T_world_body, 1e-9));
  }
}

TEST(Spline, FollowsTrajectoryBetweenKnots) {
  const Se3Spline spline = Se3Spline::through(figure_of_eight(), kPeriod);
  const double s = 3.05;  // half way between two knots
  const Motion m = spline.at(kStart + Duration::from_seconds(s));
  const Vector3d expected(3.0 * std::sin(s), 2.0 * std::sin(2.0 * s), 0.1 * s);
  EXPECT_THAT(m.T_world_body.translation, MatrixNear(expected, 1e-5));
  EXPECT_THAT(m.velocity_world,
              MatrixNear(Vector3d(3.0 * std::cos(s), 4.0 * std::cos(2.0 * s), 0.1), 1e-3));
}

TEST(Spline, ClampsStampsToSpan) {
  const Se3Spline spline = aggressive_spline();
  const Motion first = spline.at(spline.start());
  EXPECT_THAT(spline.at({0}).T_world_body, PoseNear(first.T_world_body, 0.0));
  const Motion last = spline.at(spline.end());
  EXPECT_THAT(spline.at(Stamp{spline.end().ns + 1'000'000'000}).T_world_body,
              PoseNear(last.T_world_body, 0.0));
}

TEST(Spline, RejectsTooFewPoses) {
  EXPECT_THROW(Se3Spline(kStart, kPeriod, std::vector<SE3>(5)), std::logic_error);
  EXPECT_THROW(Se3Spline(kStart, Duration{0}, std::vector<SE3>(6)), std::logic_error);
  EXPECT_THROW(Se3Spline::through(Trajectory{}, kPeriod), InputError);
  Trajectory two = figure_of_eight();
  two.poses.resize(2);
  EXPECT_THROW(Se3Spline::through(two, kPeriod), InputError);
}

}  // namespace
}  // namespace apvi
