// SPDX-License-Identifier: BSD-3-Clause
#include "eval/association.hpp"

#include <gtest/gtest.h>

#include "support/matchers.hpp"

namespace apvi::eval {
namespace {

using Eigen::Vector3d;

// Poses moving along x at 1 m/s, at the given times [s].
Trajectory along_x(const std::vector<double>& seconds) {
  Trajectory t;
  for (const double s : seconds) {
    t.poses.push_back({Stamp{} + Duration::from_seconds(s), {{1, 0, 0, 0}, Vector3d(s, 0, 0)}});
  }
  return t;
}

Trajectory every(double period_s, double from_s, double to_s) {
  std::vector<double> seconds;
  for (int i = 0; from_s + i * period_s <= to_s + 1e-9; ++i)
    seconds.push_back(from_s + i * period_s);
  return along_x(seconds);
}

constexpr AssociationOptions kNearest{
    .mode = Association::nearest, .max_difference_s = 0.01, .max_gap_s = 2.0};

TEST(Association, InterpolatesDenserEstimateAtReferenceStamps) {
  const Trajectory reference = every(1.0, 0.37, 9.37);
  const auto pairs = associate(reference, every(0.19, 0.0, 10.0), {});
  ASSERT_EQ(pairs.size(), reference.size());
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    EXPECT_EQ(pairs[i].stamp, reference.poses[i].stamp);
    EXPECT_NEAR(pairs[i].estimate.translation.x(), pairs[i].reference.translation.x(), 1e-9);
  }
  EXPECT_LT(associate(reference, every(0.19, 0.0, 10.0), kNearest).size(), reference.size());
}

TEST(Association, InterpolatesDenserReferenceAtEstimateStamps) {
  const Trajectory estimate = every(0.5, 0.123, 9.0);
  const auto pairs = associate(every(0.005, 0.0, 10.0), estimate, {});
  ASSERT_EQ(pairs.size(), estimate.size());
  EXPECT_EQ(pairs[3].stamp, estimate.poses[3].stamp);
  EXPECT_NEAR(pairs[3].reference.translation.x(), pairs[3].estimate.translation.x(), 1e-9);
}

TEST(Association, ComparesDensityWithinOverlap) {
  // 20 estimates within 2 s against 100 references within 100 s: the reference is the sparse one.
  const auto pairs = associate(every(1.0, 0.0, 100.0), every(0.1, 50.05, 52.05), {});
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_EQ(pairs[0].stamp, Stamp{51'000'000'000});
}

TEST(Association, DoesNotInterpolateInLongGaps) {
  const auto pairs =
      associate(every(1.0, 0.0, 9.0), along_x({0, 0.5, 1, 1.5, 2, 5.5, 6, 7, 8, 9}), {});
  std::vector<double> seconds;
  for (const PosePair& pair : pairs) seconds.push_back(pair.stamp.seconds());
  EXPECT_THAT(seconds, testing::ElementsAre(0, 1, 2, 6, 7, 8, 9));
}

TEST(Association, NearestMatchesClosestWithinLimit) {
  const auto pairs =
      associate(along_x({0.0, 1.0, 2.0}), along_x({0.009, 0.995, 1.004, 2.011}), kNearest);
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_DOUBLE_EQ(pairs[0].estimate.translation.x(), 0.009);
  EXPECT_DOUBLE_EQ(pairs[1].estimate.translation.x(), 1.004);
}

TEST(Association, NearestStartsFromSparserTrajectoryAndMayReusePoses) {
  const auto pairs = associate(along_x({0.0, 1.0, 2.0, 3.0}), along_x({0.995, 1.005}), kNearest);
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_DOUBLE_EQ(pairs[0].reference.translation.x(), 1.0);
  EXPECT_DOUBLE_EQ(pairs[1].reference.translation.x(), 1.0);
}

TEST(Association, NearestPrefersEarlierOfTwoEquallyNearPoses) {
  const auto pairs = associate(along_x({1.0}), along_x({0.995, 1.005}), kNearest);
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_DOUBLE_EQ(pairs[0].estimate.translation.x(), 0.995);
}

TEST(Association, NoOverlapGivesNoPairs) {
  for (const AssociationOptions& options : {AssociationOptions{}, kNearest}) {
    EXPECT_TRUE(associate(every(1, 0, 5), every(1, 10, 15), options).empty());
    EXPECT_TRUE(associate(every(1, 10, 15), every(1, 0, 5), options).empty());
    EXPECT_TRUE(associate(Trajectory{}, every(1, 0, 5), options).empty());
    EXPECT_TRUE(associate(every(1, 0, 5), Trajectory{}, options).empty());
  }
}

TEST(Coverage, IsOneWhenTheEstimateSpansTheReference) {
  EXPECT_DOUBLE_EQ(coverage(every(1, 2, 8), every(0.5, 0, 10), 2.0), 1.0);
}

TEST(Coverage, ExcludesGapsAndMissingEnds) {
  const Trajectory reference = every(1, 0, 10);
  EXPECT_NEAR(coverage(reference, every(0.5, 2, 7), 2.0), 0.5, 1e-9);
  EXPECT_NEAR(coverage(reference, along_x({0, 1, 2, 5, 6, 7, 8, 9, 10}), 2.0), 0.7, 1e-9);
  EXPECT_NEAR(coverage(reference, along_x({0, 1, 2, 5, 6, 7, 8, 9, 10}), 3.0), 1.0, 1e-9);
  EXPECT_EQ(coverage(reference, every(1, 20, 30), 2.0), 0.0);
  EXPECT_EQ(coverage(reference, Trajectory{}, 2.0), 0.0);
}

}  // namespace
}  // namespace apvi::eval
