// SPDX-License-Identifier: BSD-3-Clause
#include "io/time_units.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/dataset_builder.hpp"

namespace apvi {
namespace {

using io::SensorStamps;
using io::StampSummary;
using test::config_for;
using test::read_dataset;
using test::TmpDir;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kEpoch_s = 1.7e9;

// Stamps of a sensor over half a minute whose numbers are in units of `number_s` seconds, but whose
// header says ten to the `power` nanoseconds.
SensorStamps stamps(const std::string& kind, double step_s, double begin_s, double number_s,
                    int power) {
  return {kind, StampSummary{.column = kind + ".csv: column timestamp",
                             .is_stated = true,
                             .power = power,
                             .first = begin_s / number_s,
                             .last = (begin_s + 30.0) / number_s,
                             .step = step_s / number_s}};
}

// The unit of a sensor in company of an IMU with right stamps; the stated one if it stays.
int unit_of(const SensorStamps& sensor, double imu_begin_s) {
  const auto changes = io::decide_time_units({stamps("imu", 0.005, imu_begin_s, 1e-9, 0), sensor});
  EXPECT_FALSE(changes[0]);
  return changes[1] ? changes[1]->power : sensor.stamps->power;
}

TEST(TimeUnits, RightOnesStay) {
  for (const double begin_s : {0.0, 50.0, kEpoch_s}) {
    for (const auto& [kind, step_s] : std::map<std::string, double>{
             {"imu", 0.0025}, {"dvl", 0.2}, {"camera", 0.05}, {"pressure", 0.1}, {"depth", 1.0}}) {
      for (const auto& [power, number_s] :
           std::map<int, double>{{0, 1e-9}, {3, 1e-6}, {6, 1e-3}, {9, 1.0}}) {
        EXPECT_EQ(unit_of(stamps(kind, step_s, begin_s, number_s, power), begin_s), power)
            << kind << " " << begin_s;
      }
    }
  }
}

TEST(TimeUnits, ThatTheNumbersContradictAreReplaced) {
  for (const double begin_s : {0.5, kEpoch_s}) {
    for (const auto& [kind, step_s] : std::map<std::string, double>{
             {"imu", 0.005}, {"dvl", 0.2}, {"camera", 0.05}, {"pressure", 0.1}}) {
      for (const int power : {0, 3, 6, 9}) {
        EXPECT_EQ(unit_of(stamps(kind, step_s, begin_s, 1e-9, power), begin_s), 0) << kind << power;
        EXPECT_EQ(unit_of(stamps(kind, step_s, begin_s, 1e-6, power), begin_s), 3) << kind << power;
        EXPECT_EQ(unit_of(stamps(kind, step_s, begin_s, 1e-3, power), begin_s), 6) << kind << power;
      }
    }
  }
}

TEST(TimeUnits, OfASlowSensorAreToldByTheOthers) {
  // A pressure every 5 s in us looks like one of 200 Hz in ns.
  EXPECT_EQ(unit_of(stamps("pressure", 5.0, 3.0, 1e-6, 0), 3.0), 3);
  EXPECT_EQ(unit_of(stamps("camera", 10.0, 3.0, 1e-6, 0), 3.0), 3);
}

TEST(TimeUnits, OfADeviceThatRanForWeeksStay) {
  const double weeks_s = 2e6;  // in ns as large as a time since 1970 in us
  EXPECT_EQ(unit_of(stamps("camera", 0.05, weeks_s, 1e-9, 0), weeks_s), 0);
  EXPECT_EQ(unit_of(stamps("pressure", 0.1, weeks_s, 1e-9, 0), weeks_s), 0);
}

TEST(TimeUnits, OfASensorThatServedForAMomentOrOnAnotherClockStay) {
  SensorStamps moment = stamps("dvl", 0.2, 12.0, 1e-9, 0);
  moment.stamps->last = moment.stamps->first + 0.3e9;
  EXPECT_EQ(unit_of(moment, 0.0), 0);
  EXPECT_EQ(unit_of(stamps("camera", 0.05, 12.0, 1e-9, 0), kEpoch_s), 0);
}

std::string depth_rows(const char* header, std::int64_t step, std::int64_t begin) {
  std::string text = header;
  for (int i = 0; i < 100; ++i) text += fmt::format("{},{}\n", begin + i * step, 5.0 + 0.01 * i);
  return text;
}

TEST(TimeUnits, OfFilesAreReplacedWithAWarning) {
  const TmpDir dir;
  std::string imu = test::kImuHeader;
  for (int i = 0; i < 2000; ++i) imu += test::imu_row(1'700'000'000'000'000'000 + i * 5'000'000LL);
  test::write_imu(dir, imu);
  dir.write("mav0/depth0/data.csv",
            depth_rows("#timestamp [ns],depth [m]\n", 100'000, 1'700'000'000'000'000));
  testing::internal::CaptureStderr();
  const auto out = read_dataset(config_for(dir.path()));
  const std::string log = testing::internal::GetCapturedStderr();
  EXPECT_EQ(out.delivered("depth"), 100U);
  EXPECT_EQ(stamp_of(out.events.back()).ns, 1'700'000'000'000'000'000 + 1999 * 5'000'000LL);
  EXPECT_THAT(
      out.report.at("depth").remark,
      AllOf(HasSubstr("depth0/data.csv: column timestamp says [ns]"), HasSubstr("taken as [us]")));
  EXPECT_THAT(out.report.at("imu").remark, IsEmpty());
  EXPECT_THAT(log, HasSubstr(out.report.at("depth").remark));
}

TEST(TimeUnits, TooLargeForTheStatedOneAreReplaced) {
  const TmpDir dir;
  dir.write("mav0/depth0/data.csv",
            depth_rows("timestamp [s],depth [m]\n", 100'000'000, 1'700'000'000'000'000'000));
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_EQ(out.delivered("depth"), 100U);
  EXPECT_EQ(stamp_of(out.events.front()).ns, 1'700'000'000'000'000'000);
}

TEST(ClockShift, IsAddedToTheStampsOfASensor) {
  const TmpDir dir;
  test::write_imu(dir, test::kImuHeader + test::imu_rows({100.0, 100.1, 100.2}));
  dir.write("mav0/depth0/data.csv", "timestamp [s],depth [m]\n1.0,2\n1.1,2\n1.2,2\n");
  auto config = config_for(dir.path());
  config.clock_shift_s.pressure = 99.05;
  const auto out = read_dataset(config);
  ASSERT_EQ(out.events.size(), 6U);
  EXPECT_EQ(stamp_of(out.events[1]).ns, 100'050'000'000);
  config.clock_shift_s.pressure = -1.05;
  EXPECT_EQ(read_dataset(config).dropped("depth", io::DropReason::malformed), 1U);
}

}  // namespace
}  // namespace apvi
