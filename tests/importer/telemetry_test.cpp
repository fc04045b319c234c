// SPDX-License-Identifier: BSD-3-Clause
#include "importer/telemetry.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "importer/mp4_bytes.hpp"

namespace apvi::importer {
namespace {

using namespace test;

TimedPayload timed(const std::string& payload, double time_s, double duration_s = 1.0) {
  return {parse_gpmf(as_bytes(payload)), time_s, duration_s};
}

GpmfStream oriented(const std::string& in, const std::string& out = "",
                    const std::vector<double>& matrix = {}) {
  GpmfStream stream;
  stream.orientation_in = in;
  stream.orientation_out = out;
  stream.matrix = matrix;
  return stream;
}

// A sample in the camera's axes, minus where it should be [same unit].
double difference(const GpmfStream& stream, const Eigen::Vector3d& sample,
                  const Eigen::Vector3d& in_camera) {
  const auto R = rotation_to_camera(stream);
  return R ? (*R * sample - in_camera).norm() : 1e9;
}

TEST(Telemetry, OrientationNamesTheChannels) {
  const Eigen::Vector3d up_left_back(1.0, 2.0, 3.0);  // Z, X, Y
  const Eigen::Vector3d right_down_forward(-2.0, -1.0, -3.0);
  EXPECT_LT(difference(oriented("ZXY"), up_left_back, right_down_forward), 1e-12);
  EXPECT_LT(difference(oriented(""), up_left_back, right_down_forward), 1e-12);
  const Eigen::Vector3d back_right_up(3.0, -2.0, 1.0);  // Y, -X, Z
  EXPECT_LT(difference(oriented("YxZ"), back_right_up, right_down_forward), 1e-12);
}

TEST(Telemetry, WithoutOrientationTheChannelsAreThoseOfTheModel) {
  const Eigen::Vector3d right_down_forward(-2.0, -1.0, -3.0);
  const auto error = [&](const char* device, const Eigen::Vector3d& sample) {
    const auto R = rotation_to_camera(oriented(""), device);
    return R ? (*R * sample - right_down_forward).norm() : 1e9;
  };
  EXPECT_LT(error("HERO5 Black", {1.0, 2.0, 3.0}), 1e-12);   // Z, X, Y
  EXPECT_LT(error("Hero6 Black", {3.0, -2.0, 1.0}), 1e-12);  // Y, -X, Z
  EXPECT_LT(error("Hero7 Black", {3.0, -2.0, 1.0}), 1e-12);
  EXPECT_LT(error("GoPro Fusion", {-3.0, 2.0, 1.0}), 1e-12);  // -Y, X, Z
}

TEST(Telemetry, ImuOfAnotherUnitIsNotUsed) {
  const auto samples = [](const std::string& unit) {
    const std::vector<std::array<int, 3>> at_rest(4, {981, 0, 0});
    const std::string gyro = sensor_stream({.before = klv_text("SIUN", unit), .samples = at_rest});
    const std::string accel =
        sensor_stream({.key = "ACCL", .before = klv_text("SIUN", "m/s\xB2"), .samples = at_rest});
    return join_telemetry({timed(device(gyro + accel), 0.0)}).imu.size();
  };
  EXPECT_EQ(samples("rad/s"), 4U);
  EXPECT_EQ(samples("deg/s"), 0U);
}

TEST(Telemetry, ReportsHowFarImagesAreTurnedAgainstTheCamera) {
  const auto turned = [](int x) {  // of a scale of 1000
    const std::string scale = klv("SCAL", 's', 2, 1, i16(1000));
    const std::string data = klv("IORI", 's', 8, 1, i16(866) + i16(x) + i16(0) + i16(0));
    return join_telemetry({timed(device(nest("STRM", scale + data)), 0.0)}).image_rotation_rad;
  };
  EXPECT_DOUBLE_EQ(turned(0), 0.0);
  EXPECT_NEAR(turned(500), M_PI / 3.0, 1e-9);
}

TEST(Telemetry, MatrixAppliesBeforeTheOutputOrientation) {
  const std::vector<double> swap = {0, 0, 1, 1, 0, 0, 0, -1, 0};  // of Y, -X, Z to Z, Y, X
  const Eigen::Vector3d back_right_up(3.0, -2.0, 1.0);
  const Eigen::Vector3d right_down_forward(-2.0, -1.0, -3.0);
  EXPECT_LT(difference(oriented("YxZ", "ZYX", swap), back_right_up, right_down_forward), 1e-12);
  const std::vector<double> contradiction = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  EXPECT_LT(difference(oriented("YxZ", "XYZ", contradiction), back_right_up, right_down_forward),
            1e-12);
}

TEST(Telemetry, LettersThatNameNoFrameAreRefused) {
  for (const char* letters : {"XXY", "XYW", "XY", "XZY"}) {
    EXPECT_FALSE(rotation_to_camera(oriented(letters)).has_value()) << letters;
  }
}

std::string second_of_imu(std::uint64_t us, int value, std::size_t count) {
  const std::vector<std::array<int, 3>> samples(count, {value, 0, 0});
  return sensor_stream({.key = "ACCL", .before = stamp_us(us), .samples = samples}) +
         sensor_stream({.key = "GYRO", .before = stamp_us(us), .samples = samples});
}

TEST(Telemetry, StampsOfTheCameraPlaceSamplesAgainstTheFirstImage) {
  const auto shutter = [](std::uint64_t us) { return shutter_stream(stamp_us(us), {0.01F}); };
  const std::vector<TimedPayload> payloads = {
      timed(device(shutter(5'000'000) + second_of_imu(5'010'000, 1, 10)), 0.25),
      timed(device(shutter(6'000'000) + second_of_imu(6'030'000, 2, 10)), 1.25)};
  const std::vector<double> times = sample_times(payloads, "GYRO");
  ASSERT_EQ(times.size(), 20U);
  EXPECT_NEAR(times[0], 0.26, 1e-9);
  EXPECT_NEAR(times[5], 0.77, 1e-9);
  EXPECT_NEAR(times[10], 1.28, 1e-9);
  EXPECT_NEAR(times[11], 1.382, 1e-9);
}

TEST(Telemetry, WithoutStampsSamplesAreEvenlySpacedOverThePayloads) {
  const auto gyro = [](std::size_t count) {
    return device(sensor_stream(
        {.samples = std::vector<std::array<int, 3>>(count, std::array<int, 3>{1, 2, 3})}));
  };
  const std::vector<double> times =
      sample_times({timed(gyro(9), 0.0), timed(gyro(11), 1.0)}, "GYRO");
  ASSERT_EQ(times.size(), 20U);
  EXPECT_NEAR(times[1] - times[0], 0.1, 1e-9);
  EXPECT_NEAR(times[19], 1.9, 1e-9);
}

TEST(Telemetry, WithoutStampsALostPayloadLeavesAGap) {
  const std::string gyro = device(
      sensor_stream({.samples = std::vector<std::array<int, 3>>(10, std::array<int, 3>{1, 2, 3})}));
  const std::vector<double> times = sample_times({timed(gyro, 0.0), timed(gyro, 2.0)}, "GYRO");
  ASSERT_EQ(times.size(), 20U);
  EXPECT_NEAR(times[9], 0.9, 1e-9);
  EXPECT_NEAR(times[10], 2.0, 1e-9);
}

TEST(Telemetry, SamplesOfASinglePayloadFillIt) {
  const std::vector<double> times =
      sample_times({timed(device(second_of_imu(5'000'000, 1, 10)), 0.0, 0.5)}, "GYRO");
  ASSERT_EQ(times.size(), 10U);
  EXPECT_NEAR(times[9], 0.45, 1e-9);
}

TEST(Telemetry, GapIsNotFilledByStretchingThePayloadBeforeIt) {
  std::vector<TimedPayload> payloads;
  for (const int second : {0, 1, 2, 7, 8}) {
    payloads.push_back(timed(
        device(second_of_imu(static_cast<std::uint64_t>(second) * 1'000'000, 1, 10)), second));
  }
  const std::vector<double> times = sample_times(payloads, "GYRO");
  EXPECT_LT(times[29], 3.3);
  EXPECT_NEAR(times[30], 7.0, 1e-9);
}

TEST(Telemetry, AccelerometerIsInterpolatedAtTheTimesOfAFasterGyro) {
  const std::string gyro =
      sensor_stream({.key = "GYRO",
                     .samples = std::vector<std::array<int, 3>>(8, std::array<int, 3>{100, 0, 0})});
  const std::string accel =
      sensor_stream({.key = "ACCL", .samples = {{0, 0, 0}, {100, 0, 0}, {200, 0, 0}, {300, 0, 0}}});
  const Telemetry telemetry = join_telemetry({timed(device(gyro + accel), 0.0)});
  ASSERT_EQ(telemetry.imu.size(), 7U);  // none after the last accelerometer sample
  EXPECT_NEAR(telemetry.imu[1].accel.y(), -0.5, 1e-12);
  EXPECT_NEAR(telemetry.imu[1].gyro.y(), -1.0, 1e-12);
}

TEST(Telemetry, ExposureHasARowForEachShutterTime) {
  const std::string shutter = shutter_stream("", {0.01F, 0.02F});
  const std::string iso = nest("STRM", klv("ISOE", 'S', 2, 2, i16(100) + i16(200)));
  const std::string balance = nest("STRM", klv("WBAL", 'S', 2, 1, i16(5500)));
  const Telemetry telemetry = join_telemetry({timed(device(shutter + iso + balance), 0.0)});
  ASSERT_EQ(telemetry.exposure.size(), 2U);
  EXPECT_NEAR(*telemetry.exposure[1].shutter_s, 0.02, 1e-8);
  EXPECT_EQ(telemetry.exposure[1].iso, 200.0);
  EXPECT_EQ(telemetry.exposure[1].white_balance_k, 5500.0);
  EXPECT_FALSE(telemetry.exposure[1].gains.has_value());
  EXPECT_NEAR(telemetry.exposure[1].time_s, 0.5, 1e-9);
}

}  // namespace
}  // namespace apvi::importer
