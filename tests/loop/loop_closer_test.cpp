// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/loop/loop_closer.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "apvi/geometry/so3.hpp"
#include "support/textured_floor.hpp"

namespace apvi::loop {
namespace {

constexpr int kKeyframes = 100;
constexpr int kLap = 84;         // keyframes of a round
constexpr double kRadius = 3.0;  // [m]
constexpr double kDrift = 4e-4;  // of the heading from one keyframe to the next [rad]

Stamp stamp_of(int i) {
  return Stamp{1'000'000'000 + static_cast<std::int64_t>(i) * 500'000'000};
}

std::size_t index_of(Stamp stamp) {
  return static_cast<std::size_t>((stamp.ns - stamp_of(0).ns) / 500'000'000);
}

SE3 truth(int i) {
  const double a = 2.0 * M_PI * i / kLap;
  return test::looking_down({kRadius * std::cos(a), kRadius * std::sin(a), 2.0}, a);
}

/// As odometry has it, whose heading drifts.
SE3 odometry(int i) {
  Eigen::Vector3d place = truth(0).translation;
  for (int k = 0; k < i; ++k) {
    place += so3::exp({0.0, 0.0, kDrift * k}) * (truth(k + 1).translation - truth(k).translation);
  }
  return {so3::exp({0.0, 0.0, kDrift * i}) * truth(i).rotation, place};
}

/// Where a map has the keyframes that is told of all relocations.
struct Swim {
  std::vector<SE3> poses;
  std::size_t closures = 0;
  std::size_t told = 0;
  bool has_news_at_end = false;
  SE3 now;  ///< what holds for new ones

  void relocate(const std::vector<Relocation>& relocations) {
    if (relocations.empty()) return;
    ++told;
    for (const Relocation& moved : relocations) {
      SE3& pose = poses.at(index_of(moved.stamp));
      pose = moved.T_after_before * pose;
    }
    EXPECT_EQ(index_of(relocations.back().stamp) + 1, poses.size());
    now = relocations.back().T_after_before * now;
  }
};

Swim swim(const LoopOptions& options, int keyframes) {
  LoopCloser closer(options, test::floor_camera());
  Swim result;
  for (int i = 0; i < keyframes; ++i) {
    result.poses.push_back(result.now * odometry(i));
    result.relocate(closer.add(stamp_of(i), test::picture_of_floor(truth(i)), odometry(i)));
  }
  const std::size_t told = result.told;
  result.relocate(closer.settle());
  result.has_news_at_end = result.told > told;
  EXPECT_TRUE(closer.settle().empty());
  result.closures = closer.closures();
  return result;
}

double worst(const std::vector<SE3>& poses) {
  double most = 0.0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const SE3 there = truth(static_cast<int>(i));
    most = std::max(most, (poses[i].translation - there.translation).norm());
  }
  return most;
}

TEST(LoopCloser, ARoundThatEndsWhereItBeganComesOutRound) {
  const Swim open = swim({.least_age_s = 1000.0}, kKeyframes);
  EXPECT_EQ(open.closures, 0U);
  EXPECT_EQ(open.told, 0U);
  const Swim closed = swim({}, kKeyframes);
  EXPECT_GT(closed.closures, 5U);
  ASSERT_GT(worst(open.poses), 0.1);
  EXPECT_LT(worst(closed.poses), 0.35 * worst(open.poses));
  const SE3 last = closed.poses.back();
  EXPECT_LT(so3::angle_between(last.rotation, truth(kKeyframes - 1).rotation), 0.01);
  EXPECT_LT(closed.told, 10U);  // then it is known
}

// Within 4 s of the last bend, which otherwise would have to be waited for.
TEST(LoopCloser, WhatWasMetLastIsToldAtTheEnd) {
  const Swim end = swim({}, kLap + 2);
  EXPECT_TRUE(end.has_news_at_end);
  EXPECT_LT(worst(end.poses), 0.03);
}

TEST(LoopCloser, IsSilentBeforeAnythingIsMetAgain) {
  const Swim part = swim({}, kLap / 2);
  EXPECT_EQ(part.closures, 0U);
  EXPECT_EQ(part.told, 0U);
}

TEST(LoopCloser, KeepsToItsBudgetOfPlacesAndStillCloses) {
  const Swim closed = swim({.places = 40}, kKeyframes);
  EXPECT_GT(closed.closures, 0U);
  EXPECT_LT(worst(closed.poses), 0.5 * worst(swim({.least_age_s = 1000.0}, kKeyframes).poses));
}

TEST(LoopCloser, TakesNoKeyframeTwiceNorOneOfThePast) {
  LoopCloser closer({}, test::floor_camera());
  const cv::Mat picture = test::picture_of_floor(truth(0));
  closer.add(stamp_of(3), picture, odometry(3));
  EXPECT_TRUE(closer.add(stamp_of(3), picture, odometry(3)).empty());
  EXPECT_TRUE(closer.add(stamp_of(2), picture, odometry(2)).empty());
  closer.move(stamp_of(77), odometry(77));  // not known: no matter
}

}  // namespace
}  // namespace apvi::loop
