// SPDX-License-Identifier: BSD-3-Clause
#include "fusion/dipo_stability.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <utility>

#include "apvi/geometry/so3.hpp"
#include "fusion/random_pose.hpp"

namespace apvi::fusion {
namespace {

Stamp at(double seconds) {
  return Stamp{} + Duration::from_seconds(seconds);
}

dipo::Report ping(double seconds, double nis, dipo::Verdict verdict = dipo::Verdict::accepted) {
  dipo::Report report;
  report.stamp = at(seconds);
  report.verdict = verdict;
  report.nis = nis;
  report.rows = 3;
  return report;
}

PoseEstimate sure(double rotation_deg, double position) {
  return {SE3{}, test::diagonal(rotation_deg, position)};
}

TEST(DipoStability, UnstableBeforeTheFirstPing) {
  DipoStability stability({});
  EXPECT_EQ(stability.check(at(0.0), std::nullopt).reason, StabilityReason::absent);
  EXPECT_EQ(stability.check(at(0.0), sure(1.0, 0.1)).reason, StabilityReason::no_ping);
  stability.add(ping(0.0, 3.0));
  EXPECT_TRUE(stability.check(at(0.1), sure(1.0, 0.1)).stable());
}

TEST(DipoStability, UnstableWhenTheLastPingIsTooOld) {
  DipoStability stability({});
  stability.add(ping(1.0, 3.0));
  EXPECT_TRUE(stability.check(at(3.0), sure(1.0, 0.1)).stable());
  const Stability old = stability.check(at(3.000001), sure(1.0, 0.1));
  EXPECT_EQ(old.reason, StabilityReason::dvl_old);
  EXPECT_NEAR(old.measured, 2.000001, 1e-9);
  EXPECT_EQ(old.threshold, 2.0);
}

TEST(DipoStability, UnusedPingsDoNotResetThePingAge) {
  DipoStability stability({});
  stability.add(ping(1.0, 3.0));
  stability.add(ping(3.0, 1.0, dipo::Verdict::rejected));
  stability.add(ping(3.1, 1.0, dipo::Verdict::no_lock));
  EXPECT_EQ(stability.check(at(3.2), sure(1.0, 0.1)).reason, StabilityReason::dvl_old);
  stability.add(ping(3.15, 3.0, dipo::Verdict::downweighted));
  EXPECT_TRUE(stability.check(at(3.2), sure(1.0, 0.1)).stable());
}

TEST(DipoStability, UnstableWhenTheMedianNisIsTooLarge) {
  StabilityConfig config;
  config.nis_window_pings = 4;
  DipoStability stability(config);
  for (const double nis : {900.0, 15.0, 15.0, 15.0, 15.0}) stability.add(ping(1.0, nis));
  EXPECT_TRUE(stability.check(at(1.0), sure(1.0, 0.1)).stable());  // 5 per degree of freedom
  stability.add(ping(1.0, 900.0));
  EXPECT_TRUE(stability.check(at(1.0), sure(1.0, 0.1)).stable());  // a single outlier
  stability.add(ping(1.0, 15.3));
  const Stability worse = stability.check(at(1.0), sure(1.0, 0.1));
  EXPECT_EQ(worse.reason, StabilityReason::innovations);
  EXPECT_NEAR(worse.measured, 5.1, 1e-12);
}

TEST(DipoStability, RejectedPingsCountInTheMedianNis) {
  DipoStability stability({});
  stability.add(ping(1.0, 3.0));
  for (int i = 0; i < 9; ++i) stability.add(ping(1.0, 400.0, dipo::Verdict::rejected));
  EXPECT_EQ(stability.check(at(1.1), sure(1.0, 0.1)).reason, StabilityReason::innovations);
}

TEST(DipoStability, IgnoresHeadingUncertainty) {
  DipoStability stability({});
  stability.add(ping(0.0, 3.0));
  PoseEstimate lost = sure(1.0, 0.1);
  lost.T_world_body.rotation = so3::exp({0.5 * std::numbers::pi, 0.0, 0.0});
  lost.covariance(1, 1) = 0.25;  // the body's y axis is the world's vertical
  EXPECT_TRUE(stability.check(at(0.0), lost).stable());
  std::swap(lost.covariance(1, 1), lost.covariance(2, 2));
  EXPECT_EQ(stability.check(at(0.0), lost).reason, StabilityReason::rotation_uncertain);
}

TEST(DipoStability, UnstableWhenTiltIsUncertain) {
  DipoStability stability({});
  stability.add(ping(0.0, 3.0));
  EXPECT_TRUE(stability.check(at(0.0), sure(9.999, 0.1)).stable());
  EXPECT_EQ(stability.check(at(0.1), sure(10.001, 0.1)).reason,
            StabilityReason::rotation_uncertain);
}

TEST(DipoStability, PositionSigmaIsTestedOnlyIfConfigured) {
  DipoStability stability({});
  stability.add(ping(0.0, 3.0));
  EXPECT_TRUE(stability.check(at(0.0), sure(1.0, 50.0)).stable());
  StabilityConfig config;
  config.max_position_sigma_m = 10.0;
  DipoStability bounded(config);
  bounded.add(ping(0.0, 3.0));
  EXPECT_TRUE(bounded.check(at(0.0), sure(1.0, 9.99)).stable());
  EXPECT_EQ(bounded.check(at(0.1), sure(1.0, 10.01)).reason, StabilityReason::position_uncertain);
}

TEST(DipoStability, UnstableWhenPositionSigmaGrowsFast) {
  for (const double growth : {0.14, 0.16}) {
    StabilityConfig config;
    config.max_dvl_age_s = 100.0;
    DipoStability stability(config);
    stability.add(ping(0.0, 3.0));
    Stability last;
    for (int i = 0; i <= 60; ++i) {
      last = stability.check(at(0.05 * i), sure(1.0, 0.5 + growth * 0.05 * i));
    }
    EXPECT_EQ(last.stable(), growth < 0.15);
    if (!last.stable()) {
      EXPECT_EQ(last.reason, StabilityReason::position_growing);
      EXPECT_NEAR(last.measured, growth, 1e-9);
    }
  }
}

TEST(DipoStability, UnstableWhenNotFinite) {
  DipoStability stability({});
  stability.add(ping(0.0, 3.0));
  PoseEstimate broken = sure(1.0, 0.1);
  broken.T_world_body.translation.x() = NAN;
  EXPECT_EQ(stability.check(at(0.0), broken).reason, StabilityReason::not_finite);
  stability.add(ping(0.1, NAN));
  EXPECT_EQ(stability.check(at(0.1), sure(1.0, 0.1)).reason, StabilityReason::innovations);
}

}  // namespace
}  // namespace apvi::fusion
