// SPDX-License-Identifier: BSD-3-Clause
// The rates of a camera in the log of a gyro: made of a spline, without images.
#include <gtest/gtest.h>

#include <cmath>

#include "importer/alignment/rate_search.hpp"
#include "support/spline_imu.hpp"

namespace apvi::importer {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using test::imu_along;
using test::wavy_spline;

constexpr double kLog_s = 300.0;
constexpr double kClip_s = 30.0;
constexpr double kAt_s = 171.3;  // of the clip in the log
const Quaterniond kMounting = so3::exp({1.1, -0.7, 2.0});

std::vector<ImuSample> gyro_log(double rate_hz = 50.0) {
  std::vector<ImuSample> imu = imu_along(wavy_spline(21, kLog_s), {0.0, 0.0, -9.80665}, rate_hz);
  for (ImuSample& sample : imu) sample.gyro += Vector3d(0.02, -0.05, 0.01);  // its bias
  return imu;
}

// The rates that a camera sees between `at_s` of a log and the end of the clip, whose stamps count
// from zero; its z axis is seen badly.
std::vector<doctor::CameraRate> rates_at(const Se3Spline& spline, double at_s) {
  Random random(3);
  std::vector<doctor::CameraRate> rates;
  for (double t = 0.15; t < kClip_s - 0.15; t += 0.1) {
    const auto at = [&](double late) {
      return spline.at(spline.start() + Duration::from_seconds(at_s + t + late));
    };
    const Quaterniond turn =
        at(-0.15).T_world_body.rotation.conjugate() * at(0.15).T_world_body.rotation;
    const Vector3d noise =
        test::normal_vector(random, 0.02) + random.normal(0.0, 0.3) * Vector3d::UnitZ();
    rates.push_back(
        {Stamp{} + Duration::from_seconds(t), kMounting * so3::log(turn) / 0.3 + noise});
  }
  return rates;
}

double lag_of(double at_s) {
  return at_s + 0.15;  // the first rate is in the middle of a pair
}

TEST(RateSearch, FindsAClipInALogForAnyMounting) {
  const RateGrid gyro = rate_grid(gyro_log());
  for (const double at_s : {0.4, kAt_s, 260.0}) {
    const auto match = match_rates(rate_grid(rates_at(wavy_spline(21, kLog_s), at_s)), gyro);
    ASSERT_TRUE(match);
    EXPECT_NEAR(match->lag_s, lag_of(at_s), 0.1);
    EXPECT_GT(match->sigmas, 6.0);
    EXPECT_LT(match->elsewhere, match->correlation);
    EXPECT_LT(so3::angle_between(match->R_camera_body, kMounting), 0.3);
  }
}

TEST(RateSearch, IsNotSureOfAnotherLog) {
  const RateGrid gyro = rate_grid(gyro_log());
  for (std::uint64_t seed = 100; seed < 200; ++seed) {
    const auto match = match_rates(rate_grid(rates_at(wavy_spline(seed, kLog_s), kAt_s)), gyro);
    ASSERT_TRUE(match);
    EXPECT_LT(match->sigmas, 3.5) << seed;
  }
}

TEST(RateSearch, AMotionThatRepeatsIsAmbiguous) {
  std::vector<ImuSample> imu;
  for (double t = 0.0; t < kLog_s; t += 0.02) {
    const double yaw_rate = 0.3 * std::sin(0.5 * 3.14159265 * t);  // a swell of 4 s
    imu.push_back({Stamp{1} + Duration::from_seconds(t), {0.0, 0.0, yaw_rate}, {0.0, 0.0, 9.8}});
  }
  std::vector<doctor::CameraRate> rates;
  for (double t = 0.0; t < kClip_s; t += 0.1)
    rates.push_back(
        {Stamp{1} + Duration::from_seconds(t), {0.0, 0.3 * std::sin(0.5 * 3.14159265 * t), 0.0}});
  const auto match = match_rates(rate_grid(rates), rate_grid(imu));
  ASSERT_TRUE(match);
  EXPECT_LT(match->sigmas, 1.0);
  EXPECT_GT(match->elsewhere, 0.99);
}

TEST(RateSearch, ARangeOfLagsTellsTwoEqualDivesApart) {
  std::vector<ImuSample> imu = gyro_log();
  const std::vector<ImuSample> once = imu;
  const Duration later = Duration::from_seconds(400.0);
  for (ImuSample sample : once) {
    sample.stamp = sample.stamp + later;
    imu.push_back(sample);
  }
  const RateGrid gyro = rate_grid(imu);
  const RateGrid camera = rate_grid(rates_at(wavy_spline(21, kLog_s), kAt_s));
  EXPECT_LT(match_rates(camera, gyro)->sigmas, 1.0);
  const auto match = match_rates(camera, gyro, std::pair(400.0, 700.0));
  ASSERT_TRUE(match);
  EXPECT_NEAR(match->lag_s, lag_of(kAt_s) + 400.0, 0.1);
  EXPECT_GT(match->sigmas, 6.0);
}

TEST(RateSearch, LeftHandedAxesAreFoundAsWell) {
  std::vector<ImuSample> imu = gyro_log();
  for (ImuSample& sample : imu) sample.gyro.y() *= -1.0;
  const auto match =
      match_rates(rate_grid(rates_at(wavy_spline(21, kLog_s), kAt_s)), rate_grid(imu));
  ASSERT_TRUE(match);
  EXPECT_NEAR(match->lag_s, lag_of(kAt_s), 0.1);
}

TEST(RateSearch, GapsOfTheLogAreLeftOut) {
  std::vector<ImuSample> imu = gyro_log();
  const Stamp start = imu.front().stamp;
  std::erase_if(imu, [&](const ImuSample& sample) {
    const double t = seconds_between(start, sample.stamp);
    return (t > 180.0 && t < 186.0) || (t > 20.0 && t < 100.0);
  });
  const RateGrid gyro = rate_grid(imu);
  EXPECT_NEAR(static_cast<double>(gyro.count_known()), (kLog_s - 86.0) / kRateStep_s, 60.0);
  const auto match = match_rates(rate_grid(rates_at(wavy_spline(21, kLog_s), kAt_s)), gyro);
  ASSERT_TRUE(match);
  EXPECT_NEAR(match->lag_s, lag_of(kAt_s), 0.1);
}

TEST(RateSearch, AVideoMayBeginBeforeTheLog) {
  std::vector<ImuSample> imu = gyro_log();
  const Stamp start = imu.front().stamp;
  std::erase_if(imu, [&](const ImuSample& sample) {
    return seconds_between(start, sample.stamp) < kAt_s + 8.0;
  });
  const auto match =
      match_rates(rate_grid(rates_at(wavy_spline(21, kLog_s), kAt_s)), rate_grid(imu));
  ASSERT_TRUE(match);
  EXPECT_NEAR(match->lag_s, 0.15 - 8.0, 0.1);
}

TEST(RateSearch, ALogShorterThanTheVideoHasNoLag) {
  std::vector<ImuSample> imu = gyro_log();
  imu.resize(500);  // 10 s
  EXPECT_FALSE(match_rates(rate_grid(rates_at(wavy_spline(21, kLog_s), 0.0)), rate_grid(imu)));
}

}  // namespace
}  // namespace apvi::importer
