// SPDX-License-Identifier: BSD-3-Clause
#include "importer/vehicle/dataflash.hpp"

#include <gtest/gtest.h>

#include <sstream>

#include "core/random.hpp"
#include "importer/vehicle/dataflash_log.hpp"
#include "importer/vehicle_bytes.hpp"

namespace apvi::importer {
namespace {

using namespace test;
using Eigen::Vector3d;

SensorData read(const std::string& log) {
  std::istringstream in(log);
  return read_dataflash_log(in, "dive.BIN");
}

std::string imu_at(std::uint64_t us, std::uint8_t instance = 0, float w_x = 0.25F) {
  return dataflash_imu(us, instance, {w_x, -0.5F, 0.125F, 0.5F, -0.25F, -9.75F});
}

TEST(Dataflash, FieldsHaveTheFactorsOfTheirTypes) {
  std::istringstream in(
      dataflash_format(2, 38, "TEST", "bBhHcCiIeLQn", "a,b,c,d,e,f,g,h,i,j,k,l") +
      dataflash(
          2, little_endian(std::int8_t{-3}) + little_endian(std::uint8_t{200}) +
                 little_endian(std::int16_t{-300}) + little_endian(std::uint16_t{60000}) +
                 little_endian(std::int16_t{-150}) + little_endian(std::uint16_t{50000}) +
                 little_endian(std::int32_t{-70000}) + little_endian(std::uint32_t{4'000'000'000}) +
                 little_endian(std::int32_t{-1234}) + little_endian(std::int32_t{473'977'418}) +
                 little_endian(std::uint64_t{1} << 40) + "ab" + std::string(2, '\0')));
  std::size_t count = 0;
  for_each_dataflash_message(in, [&](const DataflashMessage& m) {
    ++count;
    EXPECT_EQ(m.name(), "TEST");
    const std::pair<const char*, double> fields[] = {
        {"a", -3.0},   {"b", 200.0},      {"c", -300.0},         {"d", 60000.0},
        {"e", -1.5},   {"f", 500.0},      {"g", -70000.0},       {"h", 4e9},
        {"i", -12.34}, {"j", 47.3977418}, {"k", 1099511627776.0}};
    for (const auto& [name, value] : fields) EXPECT_NEAR(m.number(name).value_or(0), value, 1e-9);
    EXPECT_EQ(m.text("l"), "ab");
    EXPECT_FALSE(m.number("l"));
    EXPECT_FALSE(m.number("nothing"));
  });
  EXPECT_EQ(count, 1U);
}

TEST(DataflashLog, InertialDataAreInSiUnitsAndTheAxesOfTheBody) {
  const SensorData data = read(dataflash_formats() + imu_at(1'000'000) + imu_at(1'020'000, 1));
  ASSERT_EQ(data.imu.size(), 1U);  // of the first IMU
  EXPECT_EQ(data.imu[0].stamp.ns, 1'000'000'000);
  EXPECT_EQ(data.imu[0].gyro, Vector3d(0.25, -0.5, 0.125));
  EXPECT_EQ(data.imu[0].accel, Vector3d(0.5, -0.25, -9.75));
  EXPECT_TRUE(data.is_forward_right_down);
}

TEST(DataflashLog, RawSamplesAreJoinedAtTheTimesOfTheGyro) {
  std::string log = dataflash_formats() + imu_at(1'000'000);
  log += dataflash_raw(135, 1'001'000, 1'000'000, {0.0F, 0.0F, -10.0F});
  for (unsigned i = 1; i <= 3; ++i) {
    log += dataflash_raw(134, 1'002'000, 1'000'000 + 500 * i, {1.0F * static_cast<float>(i), 0, 0});
  }
  log += dataflash_raw(135, 1'003'000, 1'002'000, {4.0F, 0.0F, -10.0F});
  const SensorData data = read(log);
  ASSERT_EQ(data.imu.size(), 3U);
  EXPECT_EQ(data.imu[0].stamp.ns, 1'000'500'000);
  EXPECT_EQ(data.imu[0].gyro.x(), 1.0);
  EXPECT_NEAR(data.imu[0].accel.x(), 1.0, 1e-12);
  EXPECT_NEAR(data.imu[2].accel.x(), 3.0, 1e-12);
}

TEST(DataflashLog, PressureIsThatOfTheBarometerInTheWater) {
  const SensorData data = read(dataflash_formats() + dataflash_baro(1000, 0, 101'000.0F) +
                               dataflash_baro(2000, 1, 151'350.0F) + imu_at(3000));
  ASSERT_EQ(data.pressure.size(), 1U);
  EXPECT_EQ(data.pressure[0].pressure_pa, 151'350.0);
  EXPECT_EQ(data.pressure[0].stamp.ns, 2'000'000);
}

TEST(DataflashLog, OldLogsNumberTheBarometersByName) {
  const SensorData data = read(dataflash_format(1, 12, "BARO", "Qf", "TimeUS,Press") +
                               dataflash_format(2, 12, "BAR2", "Qf", "TimeUS,Press") +
                               dataflash(1, little_endian(std::uint64_t{1000}) + floats({1e5F})) +
                               dataflash(2, little_endian(std::uint64_t{1000}) + floats({2e5F})));
  ASSERT_EQ(data.pressure.size(), 1U);
  EXPECT_EQ(data.pressure[0].pressure_pa, 2e5);
}

TEST(DataflashLog, AMotionBecomesAVelocity) {
  const SensorData data =
      read(dataflash_formats() + dataflash_viso(1'000'000, 0.25F, {0.125F, -0.25F, 0.5F}, 80.0F) +
           dataflash_viso(2'000'000, 0.25F, {0.125F, 0.0F, 0.0F}, 0.0F) +
           dataflash_viso(3'000'000, 0.0F, {0.125F, 0.0F, 0.0F}, 80.0F));
  ASSERT_EQ(data.dvl.size(), 2U);
  EXPECT_TRUE(data.dvl[0].velocity.isApprox(Vector3d(0.5, -1.0, 2.0)));
  EXPECT_TRUE(data.dvl[0].valid);
  EXPECT_FALSE(data.dvl[1].valid);
}

// GPS week 2312 begins 2024-04-28T00:00:00 GPS time, 18 s before UTC midnight.
TEST(DataflashLog, AFixGivesTheDate) {
  const std::string fix = dataflash_gps(2'000'000, 3, 1'500, 2312, 473'977'418, 85'455'939, 48'812);
  const SensorData data = read(dataflash_formats() + imu_at(1'000'000) + fix);
  constexpr std::int64_t kMidnight = 1'714'262'400;  // 2024-04-28T00:00:00Z
  EXPECT_EQ(data.imu.at(0).stamp.ns, (kMidnight - 18) * 1'000'000'000 + 500'000'000);
  ASSERT_EQ(data.gnss.size(), 1U);
  EXPECT_NEAR(data.gnss[0].position.latitude_deg, 47.3977418, 1e-9);
  EXPECT_NEAR(data.gnss[0].position.longitude_deg, 8.5455939, 1e-9);
  EXPECT_NEAR(data.gnss[0].position.altitude_m, 488.12, 1e-9);
  EXPECT_EQ(read(dataflash_formats() + imu_at(1'000'000) +
                 dataflash_gps(2'000'000, 1, 1'500, 2312, 473'977'418, 85'455'939, 0))
                .imu.at(0)
                .stamp.ns,
            1'000'000'000);
}

TEST(DataflashLog, ParametersDescribeTheSensors) {
  const SensorData data =
      read(dataflash_formats() + dataflash_parameter("VISO_POS_X", 0.5F) +
           dataflash_parameter("VISO_POS_Y", 0.0F) + dataflash_parameter("VISO_POS_Z", 0.25F) +
           dataflash_parameter("BARO_SPEC_GRAV", 1.024F) +
           dataflash_parameter("BARO2_GND_PRESS", 100'500.0F) + dataflash_baro(2000, 1, 2e5F));
  EXPECT_EQ(data.p_body_dvl, Vector3d(0.5, 0.0, 0.25));
  EXPECT_NEAR(data.water_density.value_or(0.0), 1024.0, 1e-3);
  EXPECT_EQ(data.surface_pressure_pa, 100'500.0);
}

TEST(DataflashLog, DamagedPartsAreSkipped) {
  const std::string log = dataflash_formats() + imu_at(1'000'000) + "\xA3\x95\xF0garbage" +
                          imu_at(1'100'000) + imu_at(1'200'000).substr(0, 20) + imu_at(1'300'000) +
                          imu_at(1'400'000) + imu_at(1'500'000).substr(0, 30);
  const SensorData data = read(log);
  std::vector<std::int64_t> stamps;
  for (const ImuSample& sample : data.imu) stamps.push_back(sample.stamp.ns / 1'000'000);
  EXPECT_EQ(stamps, (std::vector<std::int64_t>{1000, 1100, 1300, 1400}));
}

TEST(DataflashLog, FormatsThatContradictThemselvesAreNotRead) {
  for (const std::string& format :
       {dataflash_format(129, 51, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        dataflash_format(129, 51, "IMU", "QBffffff", "TimeUS,I"),
        dataflash_format(129, 51, "IMU", "??", "TimeUS,I")}) {
    EXPECT_TRUE(read(format + imu_at(1'000'000) + imu_at(2'000'000)).imu.empty());
  }
}

TEST(DataflashLog, RandomBytesNeverCrash) {
  Random random(5);
  const std::string formats = dataflash_formats();
  for (int i = 0; i < 3000; ++i) {
    std::string log = formats + imu_at(1000) + dataflash_gps(2000, 3, 1, 2312, 1, 1, 1);
    for (int change = 0; change < 20; ++change) {
      log[random.next() % log.size()] = static_cast<char>(random.next());
    }
    read(log);
  }
}

}  // namespace
}  // namespace apvi::importer
