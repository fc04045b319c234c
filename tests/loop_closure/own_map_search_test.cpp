// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/own_map_search.hpp"

#include <gtest/gtest.h>

#include "apvi/core/constants.hpp"
#include "apvi/geometry/so3.hpp"
#include "floor_dive.hpp"

namespace apvi::loop_closure {
namespace {

// Motion in the odometry frame that odometry has not seen at a break.
const SE3 kUnseen{so3::exp({0.0, 0.0, 2.1}), {6.0, -4.0, 0.3}};

// Sixty seconds at up to 2 m/s and in any direction.
constexpr DriftVariance kUnknown{.heading = 3.0, .horizontal = 1e4, .vertical = 1e4};

/// A dive with exact odometry except for breaks, after each of which it continues at a wrong pose.
struct BrokenDive {
  LoopCloser closer{closer_options(SmoothingOptions{}), floor_camera()};
  Path truth;
  SE3 T_odometry_truth;

  void break_path() { T_odometry_truth = kUnseen * T_odometry_truth; }

  void follow(const Path& path, bool after_break) {
    for (std::size_t k = 0; k < path.size(); ++k) {
      Keyframe keyframe;
      keyframe.stamp = Stamp{1'000'000'000 + static_cast<std::int64_t>(truth.size()) * 600'000'000};
      keyframe.T_world_camera = T_odometry_truth * path[k];
      keyframe.drift = after_break && k == 0
                           ? kUnknown
                           : DriftVariance{.heading = 1e-8, .horizontal = 1e-7, .vertical = 1e-8};
      truth.push_back(path[k]);
      closer.add(keyframe, render_floor(path[k]));
    }
    closer.finish();
  }

  /// Largest error of position among keyframes [m].
  double error_m(std::size_t from, std::size_t to) const {
    double largest = 0.0;
    for (std::size_t k = from; k < to; ++k) {
      const SE3 pose = closer.graph().corrected_pose(k);
      largest = std::max(largest, (pose.translation - truth[k].translation).norm());
    }
    return largest;
  }
};

const Path& first_part() {
  static const Path path = joined(line(-2.5, 2.5, 0.0), line(-2.5, 2.5, 1.2));
  return path;
}

BrokenDive with_break(const Path& afterwards) {
  BrokenDive dive;
  dive.follow(first_part(), false);
  dive.break_path();
  dive.follow(afterwards, true);
  return dive;
}

TEST(OwnMapSearch, APathThatContinuesElsewhereIsFoundAmongItsEarlierPlaces) {
  const std::size_t before = first_part().size();
  const BrokenDive dive = with_break(line(-1.5, 1.0, 0.5, 0.4));
  EXPECT_EQ(dive.closer.breaks(), 1U);
  ASSERT_EQ(dive.closer.reconnections(), 1U);
  EXPECT_LT(dive.error_m(0, before), 0.01);
  EXPECT_LT(dive.error_m(before, dive.truth.size()), 0.02);
  const SE3 last = dive.closer.graph().corrected_pose(dive.truth.size() - 1);
  EXPECT_LT(so3::angle_between(last.rotation, dive.truth.back().rotation), 0.3 * kRadiansPerDegree);
}

TEST(OwnMapSearch, LoopsAreClosedAgainAfterwards) {
  const Path there_and_back =
      joined(line(-2.0, 1.0, 0.5), joined(line(-3.5, 3.5, 4.0), line(-2.0, 2.0, 0.2)));
  const BrokenDive dive = with_break(there_and_back);
  ASSERT_EQ(dive.closer.reconnections(), 1U);
  EXPECT_GT(dive.closer.closures(), 16U);  // more than the images that found it
  EXPECT_LT(dive.error_m(0, dive.truth.size()), 0.02);
}

TEST(OwnMapSearch, APathThatContinuesInUnknownTerrainStaysWhereOdometryPutsIt) {
  const std::size_t before = first_part().size();
  const BrokenDive dive = with_break(line(-3.5, 0.0, 6.0));
  EXPECT_EQ(dive.closer.breaks(), 1U);
  EXPECT_EQ(dive.closer.reconnections(), 0U);
  EXPECT_LT(dive.error_m(0, before), 0.01);
  const SE3 expected = kUnseen * dive.truth.back();
  EXPECT_LT(
      (dive.closer.graph().corrected_pose(dive.truth.size() - 1).translation - expected.translation)
          .norm(),
      0.01);
}

TEST(OwnMapSearch, IsFoundAfterASecondBreak) {
  BrokenDive dive = with_break(line(-1.5, 1.0, 0.5, 0.4));
  dive.break_path();
  dive.follow(line(-2.0, 0.5, 0.9, -0.3), true);
  EXPECT_EQ(dive.closer.breaks(), 2U);
  EXPECT_EQ(dive.closer.reconnections(), 2U);
  EXPECT_LT(dive.error_m(0, dive.truth.size()), 0.02);
}

TEST(OwnMapSearch, DriftThatGoesOnWithoutImagesIsOneBreak) {
  BrokenDive dive;
  dive.follow(first_part(), false);
  dive.break_path();
  const std::int64_t dark = 5;
  for (std::int64_t k = 0; k < dark; ++k) {
    const auto index = static_cast<std::int64_t>(dive.truth.size());
    dive.truth.push_back(dive.truth.back());
    dive.closer.add({.stamp = Stamp{1'000'000'000 + index * 600'000'000},
                     .T_world_camera = dive.T_odometry_truth * dive.truth.back(),
                     .drift = kUnknown,
                     .height_sigma_m = {}},
                    {});
  }
  dive.follow(line(-1.5, 1.0, 0.5), true);
  EXPECT_EQ(dive.closer.breaks(), 1U);
  EXPECT_EQ(dive.closer.reconnections(), 1U);
  EXPECT_LT(dive.error_m(first_part().size() + dark, dive.truth.size()), 0.02);
}

TEST(OwnMapSearch, ABreakBeforeTheFirstPlaceDoesNoHarm) {
  LoopCloser closer(closer_options(SmoothingOptions{}), floor_camera());
  closer.add({.stamp = Stamp{1}, .T_world_camera = {}, .drift = {}, .height_sigma_m = {}}, {});
  const Path path = line(-1.0, 1.0, 0.0);
  for (std::size_t k = 0; k < path.size(); ++k) {
    closer.add({.stamp = Stamp{600'000'000 * static_cast<std::int64_t>(k + 1)},
                .T_world_camera = path[k],
                .drift = k == 0 ? kUnknown : DriftVariance{},
                .height_sigma_m = {}},
               render_floor(path[k]));
  }
  EXPECT_EQ(closer.breaks(), 1U);
  EXPECT_EQ(closer.reconnections(), 0U);
}

}  // namespace
}  // namespace apvi::loop_closure
