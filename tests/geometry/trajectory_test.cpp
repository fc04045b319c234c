// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/geometry/trajectory.hpp"

#include <gtest/gtest.h>

#include "support/matchers.hpp"

namespace apvi {
namespace {

using Eigen::Vector3d;
using test::PoseNear;

constexpr Duration kSecond{1'000'000'000};

Trajectory three_poses() {
  Trajectory t;
  t.poses = {{{1'000'000'000}, {so3::exp(Vector3d(0, 0, 0.0)), Vector3d(0, 0, 0)}},
             {{2'000'000'000}, {so3::exp(Vector3d(0, 0, 1.0)), Vector3d(3, 4, 0)}},
             {{5'000'000'000}, {so3::exp(Vector3d(0, 0, 2.0)), Vector3d(3, 4, 12)}}};
  return t;
}

TEST(Trajectory, PathLengthSumsSegments) {
  EXPECT_DOUBLE_EQ(three_poses().path_length(), 17.0);
  EXPECT_EQ(Trajectory{}.path_length(), 0.0);
}

TEST(Trajectory, MergesPosesByStamp) {
  Trajectory t = three_poses();
  const SE3 other{so3::exp(Vector3d(0, 0, 3.0)), Vector3d(7, 8, 9)};
  t.merge({{{1'500'000'000}, other}, {{2'000'000'000}, other}, {{6'000'000'000}, other}});
  ASSERT_EQ(t.size(), 5U);
  EXPECT_EQ(t.poses[1].stamp.ns, 1'500'000'000);
  EXPECT_THAT(t.poses[2].T_world_body, PoseNear(other, 0.0));
  EXPECT_EQ(t.poses[4].stamp.ns, 6'000'000'000);
}

TEST(Trajectory, ReturnsStoredPosesExactly) {
  const Trajectory t = three_poses();
  for (const StampedPose& pose : t.poses) {
    const auto found = t.at(pose.stamp, Duration{0});
    ASSERT_TRUE(found.has_value());
    EXPECT_EQ(found->translation, pose.T_world_body.translation);
    EXPECT_EQ(found->rotation.coeffs(), pose.T_world_body.rotation.coeffs());
  }
}

TEST(Trajectory, InterpolatesBetweenPoses) {
  const auto found = three_poses().at({1'250'000'000}, kSecond);
  ASSERT_TRUE(found.has_value());
  EXPECT_THAT(*found,
              PoseNear(SE3{so3::exp(Vector3d(0, 0, 0.25)), Vector3d(0.75, 1.0, 0.0)}, 1e-14));
}

TEST(Trajectory, ReturnsNothingOutsideSpanOrInLongGap) {
  const Trajectory t = three_poses();
  EXPECT_FALSE(t.at({999'999'999}, kSecond));
  EXPECT_FALSE(t.at({5'000'000'001}, kSecond));
  EXPECT_FALSE(t.at({3'000'000'000}, Duration{2'999'999'999}));
  EXPECT_TRUE(t.at({3'000'000'000}, Duration{3'000'000'000}));
  EXPECT_FALSE(Trajectory{}.at({0}, kSecond));
}

TEST(Trajectory, InterpolatesExactlyAtUnixStamps) {
  Trajectory t;
  constexpr std::int64_t kEpoch = 1'746'622'514'367'575'808;
  t.poses = {{{kEpoch}, {{1, 0, 0, 0}, Vector3d(0, 0, 0)}},
             {{kEpoch + 10}, {{1, 0, 0, 0}, Vector3d(10, 0, 0)}}};
  EXPECT_DOUBLE_EQ(t.at({kEpoch + 3}, kSecond)->translation.x(), 3.0);
}

}  // namespace
}  // namespace apvi
