// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/sensors/samples.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace apvi {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr Stamp kStamp{42};

TEST(Samples, ReturnStampAndKind) {
  EXPECT_EQ(kind_of(ImuSample{.stamp = kStamp}), "imu");
  EXPECT_EQ(kind_of(DvlSample{}), "dvl");
  EXPECT_EQ(kind_of(PressureSample{.stamp = kStamp}), "pressure");
  EXPECT_EQ(kind_of(PressureDepthSample{.stamp = kStamp}), "depth");
  EXPECT_EQ(kind_of(ImageFrame{.stamp = kStamp, .camera = 0, .decode = {}}), "camera");
  EXPECT_EQ(kind_of(GnssSample{.stamp = kStamp}), "gnss");
  EXPECT_EQ(stamp_of(PressureDepthSample{.stamp = kStamp}), kStamp);
}

TEST(Samples, DetectNonFiniteNumbers) {
  EXPECT_TRUE(is_finite(ImuSample{}));
  EXPECT_FALSE(is_finite(ImuSample{.stamp = {}, .gyro = {0, kNan, 0}, .accel = {0, 0, 0}}));
  EXPECT_FALSE(is_finite(ImuSample{.stamp = {}, .gyro = {0, 0, 0}, .accel = {kInfinity, 0, 0}}));
  EXPECT_FALSE(is_finite(PressureSample{.stamp = {}, .pressure_pa = kNan}));
  EXPECT_FALSE(is_finite(PressureDepthSample{.stamp = {}, .depth_m = -kInfinity}));
  EXPECT_FALSE(is_finite(GnssSample{.stamp = {}, .east_north_up = {0, 0, kNan}}));
}

TEST(Samples, DetectNonFiniteOptionalDvlFields) {
  DvlSample sample;
  EXPECT_TRUE(is_finite(sample));
  sample.beams[2] = DvlBeam{.velocity = 0.1, .range = {}, .valid = true};
  EXPECT_TRUE(is_finite(sample));
  sample.beams[2]->range = kNan;
  EXPECT_FALSE(is_finite(sample));
  sample.beams[2].reset();
  sample.altitude = kInfinity;
  EXPECT_FALSE(is_finite(sample));
  sample.altitude.reset();
  sample.figure_of_merit = kNan;
  EXPECT_FALSE(is_finite(sample));
}

}  // namespace
}  // namespace apvi
