// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/mavlink_log.hpp"

#include <gtest/gtest.h>

#include <sstream>

#include "apvi/core/constants.hpp"
#include "core/random.hpp"
#include "importer/vehicle/log_clock.hpp"
#include "importer/vehicle_bytes.hpp"

namespace apvi::importer {
namespace {

using namespace test;
using Eigen::Vector3d;
using io::mavlink::Id;

constexpr std::uint64_t kBoot_us = 1'700'000'000'000'000;  // when the autopilot was switched on

SensorData read(const std::string& log) {
  std::istringstream in(log);
  return read_mavlink_log(in, "dive.tlog");
}

std::string imu_at(std::uint64_t boot_us, std::uint64_t delay_us = 0) {
  return telemetry(kBoot_us + boot_us + delay_us,
                   raw_imu_frame(boot_us, {100, -200, -1000, 10, -20, 30}));
}

TEST(MavlinkLog, SamplesAreInSiUnitsOnTheClockOfTheGroundStation) {
  const SensorData data = read(imu_at(5'000'000));
  ASSERT_EQ(data.imu.size(), 1U);
  EXPECT_EQ(data.imu[0].stamp.ns, 1'700'000'005'000'000'000);
  EXPECT_TRUE(data.imu[0].accel.isApprox(kStandardGravity * Vector3d(0.1, -0.2, -1.0), 1e-12));
  EXPECT_TRUE(data.imu[0].gyro.isApprox(Vector3d(0.01, -0.02, 0.03), 1e-12));
}

TEST(MavlinkLog, DelaysOfTheLinkDoNotReachTheStamps) {
  std::string log;
  for (std::uint64_t i = 0; i < 500; ++i) log += imu_at(1'000'000 + 20'000 * i, 3000 * (i % 7));
  const SensorData data = read(log);
  ASSERT_EQ(data.imu.size(), 500U);
  for (std::size_t i = 0; i < data.imu.size(); ++i) {
    const auto true_ns = static_cast<std::int64_t>(1000 * (kBoot_us + 1'000'000 + 20'000 * i));
    EXPECT_NEAR(static_cast<double>(data.imu[i].stamp.ns - true_ns), 0.0, 1e3);
  }
}

TEST(MavlinkLog, ARestartOfTheAutopilotBeginsANewClock) {
  const auto late = [](std::uint64_t boot_us) {
    return telemetry(kBoot_us + 900'000'000 + boot_us, raw_imu_frame(boot_us, {0, 0, -1000}));
  };
  const SensorData data = read(imu_at(500'000'000) + imu_at(500'100'000) + late(1'000'000));
  ASSERT_EQ(data.imu.size(), 3U);
  EXPECT_EQ(data.imu[2].stamp.ns, 1'700'000'901'000'000'000);
}

TEST(MavlinkLog, PressureIsThatOfTheBarometerInTheWater) {
  const SensorData data =
      read(telemetry(kBoot_us + 1'000'000, pressure_frame(Id::scaled_pressure, 1000, 1013.25F)) +
           telemetry(kBoot_us + 1'000'000, pressure_frame(Id::scaled_pressure2, 1000, 1513.5F)));
  ASSERT_EQ(data.pressure.size(), 1U);
  EXPECT_EQ(data.pressure[0].pressure_pa, 151'350.0);
}

TEST(MavlinkLog, AMotionWithoutAStampIsStampedOnArrival) {
  const SensorData data =
      read(telemetry(kBoot_us + 7'000'000, delta_frame(0, 250'000, {0.125F, -0.25F, 0.5F}, 90.0F)));
  ASSERT_EQ(data.dvl.size(), 1U);
  EXPECT_EQ(data.dvl[0].stamp.ns, 1'700'000'007'000'000'000);
  EXPECT_TRUE(data.dvl[0].velocity.isApprox(Vector3d(0.5, -1.0, 2.0)));
  EXPECT_TRUE(data.dvl[0].valid);
}

TEST(MavlinkLog, OtherVehiclesAreNotMixedIn) {
  io::mavlink::Frame other = raw_imu_frame(1'000'000, {0, 0, 0});
  other.system = 2;
  EXPECT_EQ(read(imu_at(1'000'000) + telemetry(kBoot_us, other)).imu.size(), 1U);
}

TEST(MavlinkLog, FixesAndParametersAreRead) {
  io::mavlink::Frame gps = autopilot_frame(Id::gps_raw_int);
  gps.set<std::uint64_t>(0, 2'000'000);
  gps.set<std::int32_t>(8, 473'977'418);
  gps.set<std::int32_t>(12, 85'455'939);
  gps.set<std::int32_t>(16, 488'120);
  gps.set<std::uint8_t>(28, 3);
  io::mavlink::Frame parameter = autopilot_frame(Id::param_value);
  parameter.set<float>(0, 1.024F);
  const std::string name = "BARO_SPEC_GRAV";
  for (std::size_t i = 0; i < name.size(); ++i) parameter.set<char>(8 + i, name[i]);
  const SensorData data = read(imu_at(1'000'000) + telemetry(kBoot_us + 2'000'000, gps) +
                               telemetry(kBoot_us + 2'000'000, parameter));
  ASSERT_EQ(data.gnss.size(), 1U);
  EXPECT_NEAR(data.gnss[0].position.latitude_deg, 47.3977418, 1e-9);
  EXPECT_NEAR(data.gnss[0].position.altitude_m, 488.12, 1e-9);
  EXPECT_NEAR(data.water_density.value_or(0.0), 1024.0, 1e-3);
}

TEST(MavlinkLog, DamagedPartsAreSkipped) {
  std::string damaged = imu_at(2'000'000);
  damaged[30] ^= 1;
  const SensorData data = read(imu_at(1'000'000) + damaged + "\xFD\x01" + imu_at(3'000'000) +
                               imu_at(4'000'000).substr(0, 25));
  ASSERT_EQ(data.imu.size(), 2U);
  EXPECT_EQ(data.imu[1].stamp.ns, 1'700'000'003'000'000'000);
}

TEST(MavlinkLog, RandomBytesNeverCrash) {
  Random random(7);
  for (int i = 0; i < 3000; ++i) {
    std::string log = imu_at(1'000'000) + imu_at(2'000'000) +
                      telemetry(kBoot_us, delta_frame(0, 250'000, {1.0F, 0.0F, 0.0F}, 90.0F));
    for (int change = 0; change < 10; ++change) {
      log[random.next() % log.size()] = static_cast<char>(random.next());
    }
    read(log);
  }
}

TEST(LogClock, FollowsADriftingClock) {
  LogClock clock;
  Random random(11);
  const Stamp start{1'700'000'000'000'000'000};
  for (int i = 0; i < 3600; ++i) {
    const double time = i;
    const double drift = 40e-6 * time;
    const double delay = 0.002 + 0.05 * random.uniform();
    clock.add(Stamp{} + Duration::from_seconds(time),
              start + Duration::from_seconds(time + drift + delay));
  }
  clock.fit();
  for (const double time : {0.0, 1800.0, 3599.0}) {
    const Stamp stamp = clock.to_arrival(Stamp{} + Duration::from_seconds(time));
    EXPECT_NEAR(seconds_between(start, stamp), time * (1.0 + 40e-6) + 0.002, 2e-3);
  }
}

}  // namespace
}  // namespace apvi::importer
