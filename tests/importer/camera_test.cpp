// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "importer/assumed_camera.hpp"
#include "importer/image_encoder.hpp"
#include "io/dataset_builder.hpp"

namespace apvi::importer {
namespace {

using testing::HasSubstr;

constexpr double kDegree = M_PI / 180.0;

TEST(AssumedCamera, GivenAngleSpansTheWidthOfTheImage) {
  const auto p = assumed_camera({.degrees = 90.0}, {640, 480}, true);
  EXPECT_EQ(p.distortion, Distortion::none);
  EXPECT_NEAR(p.fx, 320.0, 1e-9);
  EXPECT_EQ(p.cx, 319.5);
}

TEST(AssumedCamera, FlatPortRefractsRaysOfTheWideMode) {
  const auto view = gopro_field_of_view("HERO10 Black", "", std::nullopt);
  ASSERT_TRUE(view);
  const CameraModel camera(assumed_camera(*view, {960, 540}, true));
  const double f_air = 480.0 / (59.0 * kDegree);
  for (const double degrees : {5.0, 20.0, 35.0, 40.0}) {
    const double a = degrees * kDegree;
    const auto pixel = camera.project({std::sin(a), 0.0, std::cos(a)});
    ASSERT_TRUE(pixel) << degrees;
    EXPECT_NEAR(pixel->x() - 479.5, f_air * std::asin(1.333 * std::sin(a)), 0.5) << degrees;
  }
}

TEST(AssumedCamera, InAirTheWideModeIsEquidistant) {
  const auto view = gopro_field_of_view("HERO10 Black", "W", std::nullopt);
  const auto p = assumed_camera(*view, {960, 540}, false);
  EXPECT_EQ(p.distortion, Distortion::equidistant);
  EXPECT_EQ(p.coefficients[0], 0.0);
  EXPECT_NEAR(p.fx, 480.0 / (59.0 * kDegree), 1e-9);
}

TEST(AssumedCamera, ReportedDiagonalReplacesTheNominalAngle) {
  const auto view = gopro_field_of_view("HERO10 Black", "L", 90.0);
  const auto p = assumed_camera(*view, {300, 400}, false);
  EXPECT_NEAR(p.fx, 250.0, 1e-9);
  EXPECT_FALSE(gopro_field_of_view("PHONE", "", std::nullopt).has_value());
}

TEST(AssumedCamera, RejectsAnglesThatTheLensCannotHave) {
  EXPECT_THAT(test::input_error([] {
                assumed_camera({.degrees = 180.0}, {4, 4}, true);
              }),
              HasSubstr("between 1 and 160"));
}

TEST(ImageScale, KeepsPointsAtTheSameRelativePlace) {
  CameraModel::Parameters p;
  p.fx = p.fy = 800.0;
  p.cx = 639.5;
  p.cy = 359.5;
  p.width = 1280;
  p.height = 720;
  const auto half = scaled(p, 0.5);
  EXPECT_EQ(half.width, 640);
  EXPECT_DOUBLE_EQ(half.fx, 400.0);
  EXPECT_DOUBLE_EQ(half.cx, 319.5);
}

}  // namespace
}  // namespace apvi::importer
