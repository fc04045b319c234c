// SPDX-License-Identifier: BSD-3-Clause
#include "live/mavlink_poses.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace apvi::live {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using io::mavlink::Frame;

// In a world with z up: the body (forward, right, down) is level, faces x, and is 3 m deep.
PoseOutput level_pose() {
  PoseOutput pose;
  pose.stamp = Stamp{1'700'000'000'123'456'789};
  pose.T_world_body = {Quaterniond(0.0, 1.0, 0.0, 0.0), Vector3d(1.0, 2.0, -3.0)};
  pose.v_body = Vector3d(0.5, 0.0, 0.25);
  pose.resets = 258;
  pose.trusted = true;
  return pose;
}

Vector3d vector_at(const Frame& frame, std::size_t offset) {
  return {frame.get<float>(offset), frame.get<float>(offset + 4), frame.get<float>(offset + 8)};
}

// Offsets as in the message definition that pymavlink 2.4 unpacks ODOMETRY with,
// "<Qfff4fffffff21f21fBBBBb".
TEST(MavlinkPoses, OdometryIsInAFrameForwardRightDown) {
  const Frame frame = mavlink_odometry(level_pose(), true);
  EXPECT_EQ(frame.get<std::uint64_t>(0), 1'700'000'000'123'456U);
  EXPECT_EQ(vector_at(frame, 8), Vector3d(1.0, -2.0, 3.0));
  EXPECT_NEAR(std::abs(frame.get<float>(20)), 1.0, 1e-6);  // level: no rotation
  EXPECT_EQ(vector_at(frame, 36), Vector3d(0.5, 0.0, 0.25));
  EXPECT_EQ(frame.get<std::uint8_t>(228), 20);
  EXPECT_EQ(frame.get<std::uint8_t>(229), 12);
  EXPECT_EQ(frame.get<std::uint8_t>(230), 2);  // the counter is a byte
  EXPECT_TRUE(std::isnan(frame.get<float>(60)));
  EXPECT_EQ(vector_at(mavlink_odometry(level_pose(), false), 8), Vector3d(1.0, 2.0, -3.0));
}

TEST(MavlinkPoses, CovarianceHasPositionFirst) {
  PoseOutput pose = level_pose();
  pose.covariance.emplace();
  pose.covariance->setZero();
  pose.covariance->diagonal() << 1.0, 2.0, 3.0, 4.0, 5.0, 6.0;  // rotation, position
  (*pose.covariance)(3, 4) = (*pose.covariance)(4, 3) = 0.5;    // x with y
  const Frame frame = mavlink_odometry(pose, true);
  // The diagonal in the upper triangle by rows: 0, 6, 11, 15, 18, 20.
  const std::pair<std::size_t, float> entries[] = {{0, 4.0F},  {1, -0.5F}, {6, 5.0F}, {11, 6.0F},
                                                   {15, 1.0F}, {18, 2.0F}, {20, 3.0F}};
  for (const auto& [index, value] : entries) EXPECT_EQ(frame.get<float>(60 + 4 * index), value);
}

TEST(MavlinkPoses, DeltaIsTheMotionInTheFirstBodyFrame) {
  const PoseOutput from = level_pose();
  PoseOutput to = from;
  to.stamp = from.stamp + Duration{50'000'000};
  const SE3 motion{Quaterniond(Eigen::AngleAxisd(0.1, Vector3d::UnitZ())),
                   Vector3d(0.25, 0.5, 1.0)};
  to.T_world_body = from.T_world_body * motion;
  const auto frame = mavlink_position_delta(from, to);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->get<std::uint64_t>(8), 50'000U);
  EXPECT_TRUE(vector_at(*frame, 16).isApprox(Vector3d(0.0, 0.0, 0.1), 1e-5));
  EXPECT_TRUE(vector_at(*frame, 28).isApprox(Vector3d(0.25, 0.5, 1.0), 1e-5));
  ++to.resets;
  EXPECT_FALSE(mavlink_position_delta(from, to));
}

}  // namespace
}  // namespace apvi::live
