// SPDX-License-Identifier: BSD-3-Clause
#include "runs/live/live_trace.hpp"

#include <gtest/gtest.h>

#include "apvi/geometry/so3.hpp"

namespace apvi::runs {
namespace {

Stamp at(double t_s) {
  return Stamp{} + Duration::from_seconds(t_s);
}

StampedPose pose(double t_s, double x) {
  return {at(t_s), {so3::exp({0.0, 0.0, 0.1 * t_s}), {x, 0.0, 0.0}}};
}

Trajectory keyframes(const std::vector<StampedPose>& poses) {
  return {.poses = poses};
}

LiveTrace line() {
  LiveTrace trace;
  for (int k = 0; k <= 10; ++k) trace.add(pose(k, k), "fused");
  return trace;
}

double x_of(const LiveTrace& trace, std::size_t i) {
  return trace.poses()[i].pose.T_world_body.translation.x();
}

TEST(LiveTrace, IsTheOdometryWithoutKeyframes) {
  LiveTrace trace = line();
  EXPECT_FALSE(trace.follow({}));
  for (std::size_t i = 0; i <= 10; ++i) EXPECT_EQ(x_of(trace, i), static_cast<double>(i));
}

TEST(LiveTrace, LiesOnTheKeyframesAndIsInterpolatedBetweenThem) {
  LiveTrace trace = line();
  EXPECT_TRUE(trace.follow(keyframes({pose(2, 2.0), pose(6, 6.4)})));
  EXPECT_NEAR(x_of(trace, 1), 1.0, 1e-12);
  EXPECT_NEAR(x_of(trace, 2), 2.0, 1e-12);
  EXPECT_NEAR(x_of(trace, 4), 4.2, 1e-12);
  EXPECT_NEAR(x_of(trace, 6), 6.4, 1e-12);
  EXPECT_NEAR(x_of(trace, 10), 10.4, 1e-12);
  trace.add(pose(11, 11), "dipo_only");
  EXPECT_NEAR(x_of(trace, 11), 11.4, 1e-12);
  EXPECT_EQ(trace.poses()[11].state, "dipo_only");
}

TEST(LiveTrace, IsNotMovedByMillimeters) {
  LiveTrace trace = line();
  EXPECT_FALSE(trace.follow(keyframes({pose(2, 2.005)})));
  EXPECT_EQ(x_of(trace, 2), 2.0);
  EXPECT_TRUE(trace.follow(keyframes({pose(2, 2.02)})));
  EXPECT_FALSE(trace.follow(keyframes({pose(2, 2.02)})));
}

TEST(LiveTrace, AFoundScaleRewritesThePath) {
  LiveTrace trace = line();
  localization::FrameOutput output;
  EXPECT_FALSE(trace.rewrite(output));
  trace.follow(keyframes({pose(2, 3.0)}));
  output.scale_found.emplace();
  output.scale_found->to_meters.scale = 0.5;
  EXPECT_TRUE(trace.rewrite(output));
  EXPECT_NEAR(x_of(trace, 4), 2.0, 1e-12);
}

}  // namespace
}  // namespace apvi::runs
