// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/loop/place.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "apvi/geometry/so3.hpp"
#include "support/textured_floor.hpp"

namespace apvi::loop {
namespace {

using test::floor_camera;
using test::picture_of_floor;

constexpr int kFeatures = 500;
const double kSigma = 1.0 / floor_camera().fx;

SE3 above(double x, double y, double height, double heading) {
  return test::looking_down({x, y, height}, heading);
}

Place place_at(const SE3& T_world_camera) {
  return describe(picture_of_floor(T_world_camera), floor_camera(), kFeatures);
}

/// A place whose depth the picture from half a metre beside has told.
Place known_place_at(const SE3& T_world_camera) {
  Place place = place_at(T_world_camera);
  SE3 beside = T_world_camera;
  beside.translation.x() += 0.4;
  give_depth(place, place_at(beside), beside.inverse() * T_world_camera, kSigma);
  return place;
}

TEST(Place, TwoPicturesTellHowFarItIs) {
  const SE3 here = above(0.0, 0.0, 2.0, 0.0);
  const Place place = known_place_at(here);
  EXPECT_GT(place.depths(), 100U);
  EXPECT_LT(place.depths(), place.points.size());  // what one of them does not show has no depth
  double sum = 0.0;
  for (const auto& point : place.points) {
    if (point) sum += std::abs((here * *point).z());  // the floor is at zero
  }
  EXPECT_LT(sum / static_cast<double>(place.depths()), 0.05);
}

TEST(Place, IsRecognisedFromElsewhere) {
  const SE3 here = above(0.0, 0.0, 2.0, 0.0);
  const Place then = known_place_at(here);
  for (const SE3& there : {above(0.3, -0.2, 2.2, 0.3), above(-0.3, 0.3, 1.7, -2.5)}) {
    const auto sighting = recognise(then, place_at(there), kSigma, 20);
    ASSERT_TRUE(sighting.has_value());
    const SE3 T_now_then = there.inverse() * here;
    EXPECT_LT((sighting->T_now_then.translation - T_now_then.translation).norm(), 0.02);
    EXPECT_LT(so3::angle_between(sighting->T_now_then.rotation, T_now_then.rotation), 0.01);
    EXPECT_GE(sighting->matches, sighting->inliers);
  }
}

TEST(Place, IsNoneThatOnlyLooksAlike) {
  const Place then = known_place_at(above(0.0, 0.0, 2.0, 0.0));
  EXPECT_FALSE(recognise(then, place_at(above(6.0, 0.0, 2.0, 0.0)), kSigma, 20).has_value());
}

TEST(Place, HazeAndLessLightLeaveItKnown) {
  const SE3 here = above(0.0, 0.0, 2.0, 0.0);
  const SE3 there = above(0.2, 0.1, 2.0, 0.2);
  const Place then = known_place_at(here);
  const cv::Mat hazy = 0.25 * picture_of_floor(there) + 90.0;
  EXPECT_TRUE(recognise(then, describe(hazy, floor_camera(), kFeatures), kSigma, 20).has_value());
}

TEST(Place, OfAnEvenPictureHasNoFeatures) {
  const Place place = describe(cv::Mat(240, 320, CV_8U, cv::Scalar(60)), floor_camera(), kFeatures);
  EXPECT_TRUE(place.rays.empty());
  EXPECT_TRUE(match(place, place_at(above(0.0, 0.0, 2.0, 0.0))).empty());
  EXPECT_FALSE(recognise(place, place, kSigma, 20).has_value());
}

}  // namespace
}  // namespace apvi::loop
