// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/vertical_motion.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/random.hpp"
#include "io/dataset_builder.hpp"
#include "io/folder/pressure_unit.hpp"

namespace apvi {
namespace {

using io::PressureReading;
using io::VerticalMotion;
using test::config_for;
using test::input_error;
using test::read_dataset;
using test::TmpDir;
using testing::HasSubstr;

constexpr double kSeconds = 60.0;

// A vehicle that dives and rises with this amplitude, from this depth on [m].
struct Dive {
  double shallow_m = 0.2;
  double amplitude_m = 1.0;

  double depth_m(double t) const { return shallow_m + amplitude_m * (1.0 - std::cos(0.2 * t)); }
  double down(double t) const { return 0.2 * amplitude_m * std::sin(0.2 * t); }
  double pascal(double t) const { return 101325.0 + 9806.65 * 1.02 * depth_m(t); }
};

// The DVL of the rig looks down: its z axis and the vehicle's are opposite.
DvlCalibration downward_dvl() {
  DvlCalibration dvl;
  dvl.T_body_dvl.rotation = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitX());
  return dvl;
}

VerticalMotion motion_of(const Dive& dive, Random& random) {
  VerticalMotion motion(downward_dvl());
  for (double t = 0.0; t < kSeconds; t += 0.01) {
    motion.add(ImuSample{Stamp{} + Duration::from_seconds(t), {}, {0.0, 0.0, 1.0}});  // in g
  }
  for (double t = 0.0; t < kSeconds; t += 0.2) {
    DvlSample ping;
    ping.stamp = Stamp{} + Duration::from_seconds(t);
    ping.velocity = {0.4, 0.0, dive.down(t) + random.normal(0.0, 0.01)};
    ping.valid = true;
    motion.add(ping);
  }
  return motion;
}

std::vector<PressureReading> readings_of(const Dive& dive, double pascal_per_unit, double offset_pa,
                                         Random& random) {
  std::vector<PressureReading> readings;
  for (double t = 0.05; t < kSeconds; t += 0.1) {
    const double pascal = dive.pascal(t) + random.normal(0.0, 100.0);
    readings.push_back(
        {Stamp{} + Duration::from_seconds(t), (pascal - offset_pa) / pascal_per_unit});
  }
  return readings;
}

TEST(VerticalMotion, TellsHowReadingsGrowWithDepth) {
  Random random(3);
  const Dive dive;
  const auto readings = readings_of(dive, 6894.757, 101325.0, random);
  const auto growth = motion_of(dive, random).growth_per_meter(readings);
  ASSERT_TRUE(growth);
  EXPECT_NEAR(*growth * 6894.757, 9806.65 * 1.02, 400.0);
}

TEST(VerticalMotion, SaysNothingOfALevelDiveOrOfReadingsThatDoNotFollow) {
  Random random(4);
  const Dive level{.shallow_m = 5.0, .amplitude_m = 0.02};
  EXPECT_FALSE(
      motion_of(level, random).growth_per_meter(readings_of(level, 1e4, 101325.0, random)));
  const Dive dive;
  auto readings = readings_of(dive, 1e4, 101325.0, random);
  for (PressureReading& reading : readings) reading.value = random.normal(5.0, 1.0);
  EXPECT_FALSE(motion_of(dive, random).growth_per_meter(readings));
  for (auto& reading : readings) reading.value = -dive.depth_m(reading.stamp.seconds());
  EXPECT_FALSE(motion_of(dive, random).growth_per_meter(readings));  // a height
}

// Writes a dive whose pressures have no unit.
void write_dive(const TmpDir& dir, const Dive& dive, double pascal_per_unit, double offset_pa) {
  Random random(5);
  std::string imu = test::kImuHeader;
  std::string dvl = "#timestamp [ns],v_x,v_y,v_z,valid\n";
  std::string pressure = "#timestamp [ns],pressure\n";
  for (int i = 0; i < 6000; ++i) imu += fmt::format("{},0,0,0.1,0,0,9.81\n", i * 10'000'000LL);
  for (int i = 0; i < 300; ++i) {
    dvl += fmt::format("{},0.4,0,{:.5f},1\n", i * 200'000'000LL, dive.down(0.2 * i));
  }
  for (const auto& reading : readings_of(dive, pascal_per_unit, offset_pa, random)) {
    pressure += fmt::format("{},{:.9g}\n", reading.stamp.ns, reading.value);
  }
  test::write_imu(dir, imu);
  dir.write("mav0/dvl0/data.csv", dvl);
  dir.write("mav0/pressure0/data.csv", pressure);
  dir.write("rig.yaml",
            "imu0: {}\npressure0: {}\ndvl0: {T_body_sensor: [1,0,0,0, 0,-1,0,0, 0,0,-1,0, "
            "0,0,0,1]}\n");
}

double greatest_error_pa(const TmpDir& dir, const Dive& dive) {
  double greatest = 0.0;
  for (const SensorEvent& event : read_dataset(config_for(dir.path())).events) {
    const auto* sample = std::get_if<PressureSample>(&event);
    if (sample == nullptr) continue;
    const double pascal = dive.pascal(sample->stamp.seconds());
    greatest = std::max(greatest, std::abs(sample->pressure_pa - pascal));
  }
  return greatest;
}

TEST(PressureUnit, IsToldByTheVerticalMotionOfTheDvl) {
  const TmpDir dir;
  for (const double shallow_m : {0.2, 4.0}) {
    const Dive dive{.shallow_m = shallow_m};
    for (const double unit : {1.0, 1e2, 1e3, 1e4, 1e5, 6894.757293168}) {
      write_dive(dir, dive, unit, 0.0);
      EXPECT_LT(greatest_error_pa(dir, dive), 600.0) << unit << " absolute";
      write_dive(dir, dive, unit, 101325.0);
      EXPECT_LT(greatest_error_pa(dir, dive), 600.0) << unit << " gauge";
    }
  }
}

TEST(PressureUnit, ThatMayBeAnotherOneIsInTheReport) {
  const TmpDir dir;
  const auto remark_of = [&](const Dive& dive, double unit, double offset_pa) {
    write_dive(dir, dive, unit, offset_pa);
    return read_dataset(config_for(dir.path())).report.at("pressure").remark;
  };
  const Dive moving{.shallow_m = 0.3};
  EXPECT_EQ(remark_of(moving, 1.0, 101325.0), "");  // told by the DVL
  const Dive level{.shallow_m = 0.3, .amplitude_m = 0.0};
  EXPECT_EQ(remark_of(level, 1e2, 0.0), "");  // absolute and near the surface
  EXPECT_THAT(remark_of(level, 1.0, 101325.0), HasSubstr("as Pa above the atmosphere"));
  EXPECT_THAT(remark_of(level, 1e5, 101325.0), HasSubstr("taken as dbar above the atmosphere"));
  const Dive deep{.shallow_m = 40.0, .amplitude_m = 0.0};
  EXPECT_THAT(remark_of(deep, 6894.757293168, 0.0), HasSubstr("taken as kPa, although the rig"));
}

TEST(PressureUnit, OfADeepDiveIsToldByTheVerticalMotionOfTheDvl) {
  const TmpDir dir;
  const Dive dive{.shallow_m = 40.0};  // 73 psi: as kPa that of a mountain lake
  write_dive(dir, dive, 6894.757293168, 0.0);
  EXPECT_LT(greatest_error_pa(dir, dive), 600.0);
}

}  // namespace
}  // namespace apvi
