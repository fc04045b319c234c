// SPDX-License-Identifier: BSD-3-Clause
#include "change/change_map.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "apvi/core/error.hpp"
#include "change/two_dives.hpp"

namespace apvi::change {
namespace {

constexpr double kFloor_m = -2.0;

ChangeMap changes(const Session& before, const Session& after) {
  return find_changes(before, after, {}, [](double, std::string_view) {});
}

Session bare_floor() {
  return test::session(test::floor_at(kFloor_m));
}
Session floor_with_box(double side_m) {
  return test::session(
      test::joined(test::floor_at(kFloor_m), test::box_on(kFloor_m, 0.4, -0.3, side_m)));
}

void expect_box(const Change& change, double side_m) {
  EXPECT_NEAR(change.center.x(), 0.4, 0.03);
  EXPECT_NEAR(change.center.y(), -0.3, 0.03);
  EXPECT_NEAR(change.high.z(), kFloor_m + side_m, 0.025);
  // The silhouette is smeared by two pixels, which are 1.5 cm wide here.
  EXPECT_NEAR(change.high.x() - change.low.x(), side_m + 0.06, 0.04);
  EXPECT_NEAR(change.high.y() - change.low.y(), side_m + 0.06, 0.04);
  EXPECT_GT(change.confidence, 0.9);
  EXPECT_GE(change.views, 3.0);
}

TEST(FindChanges, ABoxThatIsOnlyInTheLaterMapHasAppeared) {
  const ChangeMap map = changes(bare_floor(), floor_with_box(0.2));
  ASSERT_EQ(map.changes.size(), 1U);
  EXPECT_EQ(map.changes[0].kind, Kind::appeared);
  expect_box(map.changes[0], 0.2);
  ASSERT_TRUE(map.changes[0].after);
  EXPECT_NEAR((*map.changes[0].after)[1], 0.5, 0.05);
  EXPECT_FALSE(map.changes[0].before);
}

TEST(FindChanges, ABoxThatIsOnlyInTheEarlierMapHasVanished) {
  const ChangeMap map = changes(floor_with_box(0.2), bare_floor());
  ASSERT_EQ(map.changes.size(), 1U);
  EXPECT_EQ(map.changes[0].kind, Kind::vanished);
  expect_box(map.changes[0], 0.2);
  EXPECT_FALSE(map.changes[0].after);
}

TEST(FindChanges, ABoxOfTheSmallestSizeIsFoundAndOneOfAQuarterOfItIsNot) {
  EXPECT_EQ(changes(bare_floor(), floor_with_box(0.11)).changes.size(), 1U);
  EXPECT_EQ(changes(bare_floor(), floor_with_box(0.025)).changes.size(), 0U);
}

TEST(FindChanges, ABoxElsewhereHasMoved) {
  Session before = floor_with_box(0.2);
  const Session after =
      test::session(test::joined(test::floor_at(kFloor_m), test::box_on(kFloor_m, -0.5, 0.4, 0.2)));
  const ChangeMap map = changes(before, after);
  ASSERT_EQ(map.changes.size(), 2U);
  EXPECT_EQ(map.changes[0].kind, Kind::appeared);
  EXPECT_EQ(map.changes[0].moved_from, 1U);
}

TEST(FindChanges, AStainedDiscHasChangedItsColor) {
  Session after = bare_floor();
  test::stain(after.map.gaussians, -0.4, 0.3, 0.15, 1.6);
  const ChangeMap map = changes(bare_floor(), after);
  ASSERT_EQ(map.changes.size(), 1U);
  const Change& change = map.changes[0];
  EXPECT_EQ(change.kind, Kind::color);
  EXPECT_NEAR(change.center.x(), -0.4, 0.02);
  EXPECT_NEAR(change.center.y(), 0.3, 0.02);
  // Colors are averaged within 5 cm.
  EXPECT_NEAR(change.length_m, 0.35, 0.06);
  ASSERT_TRUE(change.factors);
  EXPECT_NEAR((*change.factors)[0], 1.6, 0.2);
  EXPECT_NEAR((*change.factors)[1], 1.0, 0.05);
}

TEST(FindChanges, ShadeIsNoChange) {
  Session after = bare_floor();
  test::shade(after.map.gaussians, -0.4, 0.3, 0.3, 0.5);
  EXPECT_TRUE(changes(bare_floor(), after).changes.empty());
}

TEST(FindChanges, OtherLightIsNoChange) {
  Session after = bare_floor();
  const torch::Tensor color = gaussians::sh_dc_to_color(after.map.gaussians.sh_dc);
  after.map.gaussians.sh_dc = gaussians::color_to_sh_dc(color * torch::tensor({0.5F, 0.8F, 1.3F}));
  EXPECT_TRUE(changes(bare_floor(), after).changes.empty());
}

TEST(FindChanges, ASmallMotionBetweenTheMapsIsTakenOut) {
  Session after = floor_with_box(0.2);
  const torch::Tensor shift = torch::tensor({0.03, -0.02, 0.04}, torch::kFloat64);
  after.map.gaussians.means += shift.to(torch::kFloat32);
  for (gaussians::View& view : after.views) {
    view.T_camera_world = view.T_camera_world.clone();
    view.T_camera_world.slice(0, 0, 3).select(1, 3) -=
        view.T_camera_world.slice(0, 0, 3).slice(1, 0, 3).mv(shift);
  }
  const ChangeMap map = changes(floor_with_box(0.2), after);
  EXPECT_TRUE(map.changes.empty());
  EXPECT_NEAR(map.registration.shift_m, shift.norm().item<double>(), 0.005);
}

TEST(FindChanges, WhatOnlyOneDiveSawIsUnknown) {
  const Session before = test::session(test::floor_at(kFloor_m), test::views_over(-1.0, -0.5, 0.0));
  const Session after =
      test::session(test::joined(test::floor_at(kFloor_m), test::box_on(kFloor_m, 1.2, 0.0, 0.2)),
                    test::views_over(0.0, 1.0, 0.0));
  const ChangeMap map = changes(before, after);
  EXPECT_TRUE(map.changes.empty());
  EXPECT_GT(map.only_before_m2, 0.5);
  EXPECT_GT(map.only_after_m2, 0.5);
  EXPECT_GT(map.compared_m2, 0.5);
  EXPECT_LT(map.compared_m2 + map.only_before_m2 + map.only_after_m2, 3.2 * 3.2);
}

TEST(FindChanges, MapsOfDifferentPlacesAreRefused) {
  Session after = bare_floor();
  after.map.gaussians.means += torch::tensor({50.0F, 0.0F, 0.0F});
  for (gaussians::View& view : after.views) {
    view.T_camera_world = view.T_camera_world.clone();
    view.T_camera_world.slice(0, 0, 3).select(1, 3) -=
        50.0 * view.T_camera_world.slice(0, 0, 3).select(1, 0);
  }
  EXPECT_THROW(changes(bare_floor(), after), InputError);
}

TEST(FindChanges, AMapWithoutSurfaceIsRefused) {
  Session empty = bare_floor();
  empty.views.clear();
  EXPECT_THROW(changes(empty, bare_floor()), InputError);
  EXPECT_THROW(changes(bare_floor(), empty), InputError);
}

}  // namespace
}  // namespace apvi::change
