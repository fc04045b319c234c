// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/slew.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "fusion/random_pose.hpp"
#include "support/matchers.hpp"

namespace apvi::fusion {
namespace {

using test::PoseNear;

constexpr double kDt = 0.05;

PoseEstimate target_at(double x) {
  return {SE3{Eigen::Quaterniond::Identity(), {x, 0.0, 0.0}}, test::diagonal(1.0, 0.1)};
}

TEST(Slew, FollowsATargetThatMovesWithTheVehicle) {
  Slew slew({});
  SE3 pose{so3::exp({0.1, 0.2, 0.3}), {1.0, 2.0, 3.0}};
  slew.update(0.0, std::nullopt, {pose, Matrix6::Identity()});
  const SE3 motion{so3::exp({0.0, 0.1, 0.5}), {3.0, 0.0, 0.0}};  // far above the rate limits
  for (int i = 0; i < 10; ++i) {
    pose = pose * motion;
    EXPECT_THAT(slew.update(kDt, motion, {pose, Matrix6::Identity()}).T_world_body,
                PoseNear(pose, 1e-12));
  }
}

TEST(Slew, StepDecaysExponentiallyThenAtMinimumSpeed) {
  Slew slew({.time_constant_s = 1.0, .min_speed_m_s = 0.1, .min_rate_deg_s = 2.0});
  slew.update(0.0, std::nullopt, target_at(0.0));
  double before = 0.0;
  double left = 1.0;
  for (int i = 0; i < 60; ++i) {
    const double x = slew.update(kDt, SE3{}, target_at(1.0)).T_world_body.translation.x();
    left -= std::min(left, std::max(left * (1.0 - std::exp(-kDt)), 0.1 * kDt));
    EXPECT_NEAR(x, 1.0 - left, 1e-12);
    EXPECT_GE(x, before);
    before = x;
  }
  EXPECT_LT(left, 0.1);  // e^-3 = 0.05 without the minimum speed
  for (int i = 0; i < 20; ++i) slew.update(kDt, SE3{}, target_at(1.0));
  EXPECT_EQ(slew.update(kDt, SE3{}, target_at(1.0)).covariance, target_at(1.0).covariance);
}

TEST(Slew, CovarianceIncludesTheRemainingDifference) {
  Slew slew({});
  slew.update(0.0, std::nullopt, target_at(0.0));
  const PoseEstimate out = slew.update(kDt, SE3{}, target_at(1.0));
  const double remaining = 1.0 - out.T_world_body.translation.x();
  EXPECT_NEAR(out.covariance(3, 3), 0.01 + remaining * remaining, 1e-12);
  EXPECT_NEAR(out.covariance(4, 4), 0.01, 1e-12);
}

TEST(Slew, LimitsRotation) {
  Slew slew({.time_constant_s = 1e9, .min_speed_m_s = 0.1, .min_rate_deg_s = 2.0});
  slew.update(0.0, std::nullopt, target_at(0.0));
  PoseEstimate target = target_at(0.0);
  target.T_world_body.rotation = so3::exp({0.0, 0.0, 20.0 * kRadiansPerDegree});
  const PoseEstimate out = slew.update(kDt, SE3{}, target);
  EXPECT_NEAR(so3::yaw(out.T_world_body.rotation) / kRadiansPerDegree, 0.1, 1e-9);
}

TEST(Slew, ZeroTimeConstantJumpsToTheTarget) {
  Slew slew({.time_constant_s = 0.0, .min_speed_m_s = 0.1, .min_rate_deg_s = 2.0});
  slew.update(0.0, std::nullopt, target_at(0.0));
  EXPECT_THAT(slew.update(kDt, SE3{}, target_at(1.0)).T_world_body,
              PoseNear(target_at(1.0).T_world_body, 1e-15));
}

}  // namespace
}  // namespace apvi::fusion
