// SPDX-License-Identifier: BSD-3-Clause
#include "io/folder/units.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "apvi/core/constants.hpp"
#include "io/dataset_builder.hpp"
#include "io/folder/imu_unit.hpp"
#include "io/folder/pressure_unit.hpp"

namespace apvi {
namespace {

using io::Dimension;
using io::DropReason;
using test::config_for;
using test::input_error;
using test::read_dataset;
using test::TmpDir;
using testing::HasSubstr;

TEST(Units, AreKnownInEveryUsualSpelling) {
  for (const char* word : {"m/s", "m s^-1", "M/S", "m s-1", "m/sec", "m·s⁻¹", "mps"}) {
    const io::Unit* unit = io::find_unit(Dimension::speed, word);
    ASSERT_NE(unit, nullptr) << word;
    EXPECT_EQ(unit->to_si, 1.0) << word;
  }
  for (const char* word : {"m/s^2", "m s^-2", "m/s2", "m/s²", "m s⁻²", "m/s/s", "m/s**2"}) {
    ASSERT_NE(io::find_unit(Dimension::acceleration, word), nullptr) << word;
  }
  for (const char* word : {"deg/s", "°/s", "dps", "deg s^-1", "degree/s", "\xB0/s"}) {
    const io::Unit* unit = io::find_unit(Dimension::angular_rate, word);
    ASSERT_NE(unit, nullptr) << word;
    EXPECT_DOUBLE_EQ(unit->to_si, std::numbers::pi / 180.0) << word;
  }
  for (const char* word : {"m", "meters", "Meter"}) {
    ASSERT_NE(io::find_unit(Dimension::length, word), nullptr) << word;
    EXPECT_EQ(io::find_unit(Dimension::length, word)->to_si, 1.0) << word;
  }
  for (const char* word : {"rad/s", "rad s^-1", "rad.s^-1", "radians/sec"}) {
    ASSERT_NE(io::find_unit(Dimension::angular_rate, word), nullptr) << word;
  }
  for (const char* word : {"hPa", "mbar", "millibar", "hectopascal", "Hectopascals", "mbar abs"}) {
    const io::Unit* unit = io::find_unit(Dimension::pressure, word);
    ASSERT_NE(unit, nullptr) << word;
    EXPECT_EQ(unit->to_si, 100.0) << word;
  }
  EXPECT_EQ(io::find_unit(Dimension::pressure, "psig"), nullptr);  // not absolute
  EXPECT_EQ(io::find_unit(Dimension::length, "kilometers")->to_si, 1000.0);
  EXPECT_EQ(io::find_unit(Dimension::length, "feet")->name, "ft");
  EXPECT_EQ(io::find_unit(Dimension::speed, "m"), nullptr);
  EXPECT_EQ(io::find_unit(Dimension::pressure, "mPa"), nullptr);
}

TEST(Units, OfStampsAreToldByTheirSize) {
  EXPECT_EQ(io::guess_time_power({"1403636581838555574.0"}, 9), 0);
  EXPECT_EQ(io::guess_time_power({"1.403636581838e18"}, 9), 0);
  EXPECT_EQ(io::guess_time_power({"1403636581838555", "1403636581888555"}, 0), 3);
  EXPECT_EQ(io::guess_time_power({"1403636581838", "1403636581888"}, 0), 6);
  EXPECT_EQ(io::guess_time_power({"1403636581.838", "1403636581.888"}, 0), 9);
  EXPECT_EQ(io::guess_time_power({"1500000000", "1550000000"}, 0), 0);
  EXPECT_EQ(io::guess_time_power({"17", "18"}, 9), 9);
}

TEST(DatasetFolder, ConvertsUnitsOfHeader) {
  const TmpDir dir;
  dir.write("mav0/dvl0/data.csv",
            "timestamp_ms,v_x [mm/s],v_y (kn),vz_cm/s,altitude [ft],beam0_v [mm/s]\n"
            "1500,250,2,30,10,400\n");
  test::write_imu(dir,
                  "#time [us],w_x [deg/s],w_y [dps],w_z [rad s^-1],a_x [g],a_y [mg],a_z [m/s²]\n"
                  "1500001,180,90,1,1,500,3\n");
  dir.write("mav0/depth0/data.csv", "#timestamp [s],depth_cm\n1.500002,250\n");
  const auto out = read_dataset(config_for(dir.path()));
  ASSERT_EQ(out.events.size(), 3U);
  const auto& dvl = std::get<DvlSample>(out.events[0]);
  EXPECT_EQ(dvl.stamp.ns, 1'500'000'000);
  EXPECT_TRUE(dvl.velocity.isApprox(Eigen::Vector3d(0.25, 1852.0 / 1800.0, 0.3), 1e-12));
  EXPECT_NEAR(dvl.altitude.value(), 3.048, 1e-12);
  EXPECT_NEAR(dvl.beams[0]->velocity, 0.4, 1e-12);
  const auto& imu = std::get<ImuSample>(out.events[1]);
  EXPECT_EQ(imu.stamp.ns, 1'500'001'000);
  EXPECT_TRUE(imu.gyro.isApprox(Eigen::Vector3d(std::numbers::pi, std::numbers::pi / 2, 1), 1e-12));
  EXPECT_TRUE(imu.accel.isApprox(Eigen::Vector3d(9.80665, 4.903325, 3), 1e-12));
  EXPECT_DOUBLE_EQ(std::get<PressureDepthSample>(out.events[2]).depth_m, 2.5);
}

TEST(DatasetFolder, UnitsMayBeAppendedToNames) {
  const TmpDir dir;
  dir.write("mav0/dvl0/data.csv", "timestamp_ms,v_x_mm_s,vy_m_s,vel_z_cm_s\n1500,250,2,30\n");
  const auto out = read_dataset(config_for(dir.path()));
  ASSERT_EQ(out.events.size(), 1U);
  EXPECT_TRUE(
      std::get<DvlSample>(out.events[0]).velocity.isApprox(Eigen::Vector3d(0.25, 2.0, 0.3), 1e-12));
}

TEST(DatasetFolder, UnitsMayBeInASecondHeaderLine) {
  for (const char* units : {"ms,deg/s,dps,rad/s,g,mg,m/s^2,degC", "[ms],[deg/s],[dps],,[g],[mg],-,",
                            "#ms,deg/s,dps,rad/s,g,mg,m/s2,1", "\"ms\",°/s,dps,-,g,mg,none,?"}) {
    const TmpDir dir;
    test::write_imu(dir, fmt::format("time,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z,temp\n{}\n"
                                     "1500,180,90,1,1,500,3,20\n",
                                     units));
    const auto out = read_dataset(config_for(dir.path()));
    ASSERT_EQ(out.events.size(), 1U) << units;
    EXPECT_EQ(out.dropped("imu"), 0U) << units;
    const auto& imu = std::get<ImuSample>(out.events[0]);
    EXPECT_EQ(imu.stamp.ns, 1'500'000'000) << units;
    EXPECT_TRUE(
        imu.gyro.isApprox(Eigen::Vector3d(std::numbers::pi, std::numbers::pi / 2, 1), 1e-12));
    EXPECT_TRUE(imu.accel.isApprox(Eigen::Vector3d(9.80665, 4.903325, 3), 1e-12));
  }
}

TEST(DatasetFolder, UnknownUnitOfASecondHeaderLineIsAnError) {
  const TmpDir dir;
  dir.write("mav0/depth0/data.csv", "time,depth\ns,furlong\n1.5,2\n");
  EXPECT_THAT(input_error([&] { read_dataset(config_for(dir.path())); }),
              HasSubstr("column depth: unknown unit [furlong]"));
}

TEST(DatasetFolder, UnknownUnitIsAnErrorWithFileColumnAndKnownOnes) {
  const TmpDir dir;
  dir.write("mav0/depth0/data.csv", "#timestamp [ns],depth [furlong]\n1,2\n");
  const std::string error = input_error([&] { read_dataset(config_for(dir.path())); });
  EXPECT_THAT(error, HasSubstr("depth0/data.csv: column depth: unknown unit [furlong]"));
  EXPECT_THAT(error, HasSubstr("[m], [cm], [mm]"));
}

// Pressures of a dive from 0.2 m to 2.2 m [Pa].
std::vector<double> dive() {
  std::vector<double> pascal;
  for (int i = 0; i <= 400; ++i) pascal.push_back(101325.0 + 9806.65 * (0.2 + 0.005 * i));
  return pascal;
}

double first_pressure(const TmpDir& dir, std::vector<double> values, double factor, double offset,
                      std::size_t dropped = 0, const std::string& column = "pressure") {
  std::string text = "#timestamp [ns]," + column + "\n";
  std::int64_t ns = 0;
  for (const double v : values) {
    text += fmt::format("{},{:.9g}\n", ns += 50'000'000, (v - offset) / factor);
  }
  dir.write("mav0/pressure0/data.csv", text);
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_EQ(out.dropped("pressure", DropReason::implausible), dropped);
  EXPECT_EQ(out.delivered("pressure"), values.size() - dropped);
  return std::get<PressureSample>(out.events.at(0)).pressure_pa;
}

TEST(PressureUnit, IsInferredFromTheWholeRecording) {
  const TmpDir dir;
  for (const double factor : {1.0, 1e2, 1e3, 1e4, 1e5, 6894.757293168}) {
    EXPECT_NEAR(first_pressure(dir, dive(), factor, 0.0), dive()[0], 0.1) << factor;
  }
}

TEST(PressureUnit, FirstReadingApartFromTheRestIsDropped) {
  const TmpDir dir;
  for (const double factor : {1.0, 1e2, 1e3, 1e4, 1e5}) {
    for (const double garbage : {0.0, -2e9, 3e6}) {
      std::vector<double> values = dive();
      values.front() = garbage;
      EXPECT_NEAR(first_pressure(dir, values, factor, 0.0, 1), dive()[1], 0.1)
          << factor << " " << garbage;
    }
  }
}

TEST(PressureUnit, ZerosOfASensorThatDoesNotAnswerAreDropped) {
  const TmpDir dir;
  std::vector<double> periodic = dive();
  for (std::size_t i = 3; i < periodic.size(); i += 7) periodic[i] = 0.0;
  EXPECT_NEAR(first_pressure(dir, periodic, 1.0, 0.0, 57), dive()[0], 0.1);
  std::vector<double> most = dive();
  for (std::size_t i = 0; i < most.size(); ++i) most[i] = i % 4 == 1 ? most[i] : 0.0;
  EXPECT_NEAR(first_pressure(dir, most, 1.0, 0.0, 301, "pressure [Pa]"), dive()[1], 0.1);
  std::vector<double> late = dive();
  std::fill_n(late.begin(), 100, 0.0);
  EXPECT_NEAR(first_pressure(dir, late, 1e2, 0.0, 100), dive()[100], 0.1);
  // Above the atmosphere, zero is the surface.
  std::vector<double> gauge = dive();
  for (double& pascal : gauge) pascal = std::max(101325.0, pascal - 7000.0);
  EXPECT_NEAR(first_pressure(dir, gauge, 1.0, 101325.0, 0, "pressure [Pa]"), 101325.0, 0.1);
}

TEST(PressureUnit, DeepPartOfADiveIsKept) {
  const TmpDir dir;
  std::vector<double> values = dive();
  for (int i = 0; i < 30; ++i) values.push_back(101325.0 + 9806.65 * (2.2 + i));
  EXPECT_NEAR(first_pressure(dir, values, 1.0, 0.0), dive()[0], 0.1);
}

TEST(PressureUnit, SeaPressureInDecibarsGetsTheAtmosphere) {
  const TmpDir dir;
  EXPECT_NEAR(first_pressure(dir, dive(), 1e4, 101325.0), dive()[0], 0.1);
  EXPECT_NEAR(first_pressure(dir, dive(), 1e4, 101325.0, 0, "pressure [dbar]"), dive()[0], 0.1);
  dir.write("rig.yaml", "pressure0: {atmospheric_pressure_pa: 0}\n");
  EXPECT_NEAR(first_pressure(dir, dive(), 1e4, 101325.0), dive()[0] - 101325.0, 0.1);
}

TEST(PressureUnit, StatedPascalsAboveTheAtmosphereGetIt) {
  const TmpDir dir;
  EXPECT_NEAR(first_pressure(dir, dive(), 1.0, 101325.0, 0, "pressure [Pa]"), dive()[0], 0.1);
  EXPECT_NEAR(first_pressure(dir, dive(), 1e2, 101325.0, 0, "pressure [hPa]"), dive()[0], 0.1);
}

TEST(PressureUnit, StatedPascalsThatLookLikeAnotherUnitAreKept) {
  const TmpDir dir;
  EXPECT_NEAR(first_pressure(dir, dive(), 1e2, 0.0, 0, "pressure [Pa]"), dive()[0] / 1e2, 0.1);
  EXPECT_NEAR(first_pressure(dir, dive(), 1e3, 0.0, 0, "pressure [Pa]"), dive()[0] / 1e3, 0.1);
}

TEST(PressureUnit, AmbiguousReadingsAreAnError) {
  const TmpDir dir;
  std::vector<double> values(100, 30.0);
  EXPECT_THAT(input_error([&] { io::evaluate_pressure(values, {.name = "p.csv"}); }),
              HasSubstr("p.csv: the unit of the pressure cannot be told"));
}

Eigen::Vector3d accel_of(const TmpDir& dir, double factor, const std::string& unit = "") {
  std::string text = fmt::format("#timestamp [ns],w_x,w_y,w_z,a_x{0},a_y{0},a_z{0}\n", unit);
  for (int i = 1; i <= 50; ++i) {
    text += fmt::format("{},0.01,0.02,0,{},0,{}\n", i * 10'000'000, 0.5 / factor, 9.8 / factor);
  }
  test::write_imu(dir, text);
  return std::get<ImuSample>(read_dataset(config_for(dir.path())).events.at(0)).accel;
}

TEST(ImuUnit, IsToldByTheSizeOfGravity) {
  const TmpDir dir;
  const Eigen::Vector3d truth(0.5, 0, 9.8);
  for (const double factor : {1.0, 9.80665, 9.80665e-3, 1e-2, 1e-3}) {
    EXPECT_TRUE(accel_of(dir, factor).isApprox(truth, 1e-6)) << factor;
  }
}

TEST(ImuUnit, OfTheHeaderIsTrusted) {
  const TmpDir dir;
  EXPECT_NEAR(accel_of(dir, 9.80665, " [m s^-2]").z(), 9.8 / 9.80665, 1e-6);
}

TEST(ImuUnit, DegreesOfACsvAreToldAsThoseOfABag) {
  const TmpDir dir;
  const Eigen::Vector3d rate(0.1, -0.05, 0.2);
  for (const char* unit : {"", " [rad/s]"}) {
    std::string text = fmt::format("#timestamp [ns],w_x{0},w_y{0},w_z{0},a_x,a_y,a_z\n", unit);
    for (int i = 1; i <= 300; ++i) {
      const Eigen::AngleAxisd turned(-0.01 * i * rate.norm(), rate.normalized());
      const Eigen::Vector3d w = rate / kRadiansPerDegree;
      const Eigen::Vector3d a = turned * Eigen::Vector3d(0.0, 2.0, 9.6);
      text += fmt::format("{},{},{},{},{},{},{}\n", i * 10'000'000LL, w.x(), w.y(), w.z(), a.x(),
                          a.y(), a.z());
    }
    test::write_imu(dir, text);
    const auto out = read_dataset(config_for(dir.path()));
    const bool stated = *unit != '\0';
    EXPECT_NEAR(std::get<ImuSample>(out.events.at(0)).gyro.z(),
                stated ? 0.2 / kRadiansPerDegree : 0.2, 1e-6);
  }
}

// A vehicle that turns at this rate [rad/s], with the gyro in another unit.
io::ImuFactors factors_of(const Eigen::Vector3d& rate, double gyro_unit, double accel_unit) {
  io::ImuEvidence evidence;
  for (int i = 0; i < 200; ++i) {
    const double t = 0.01 * i;
    const Eigen::AngleAxisd turned(-rate.norm() * t, rate.normalized());
    evidence.add({Stamp{} + Duration::from_seconds(t), rate / gyro_unit,
                  turned * Eigen::Vector3d(0.0, 2.0, 9.6) / accel_unit});
  }
  return io::imu_factors(evidence, {}, "/imu");
}

TEST(ImuUnit, DegreesAreToldByRatesAndGravity) {
  const Eigen::Vector3d slow(0.1, -0.05, 0.2);
  for (const double accel_unit : {1.0, 9.80665}) {
    EXPECT_DOUBLE_EQ(factors_of(slow, kRadiansPerDegree, accel_unit).gyro, kRadiansPerDegree);
    EXPECT_NEAR(factors_of(slow, kRadiansPerDegree, accel_unit).accel, accel_unit, 1e-12);
  }
  EXPECT_DOUBLE_EQ(factors_of({0, 0, 0.2}, kRadiansPerDegree, 1.0).gyro, kRadiansPerDegree);
}

TEST(ImuUnit, RatesThatMayBeAnythingAreKept) {
  const Eigen::Vector3d slow(0.1, -0.05, 0.2);
  EXPECT_EQ(factors_of(slow, 1.0, 1.0).gyro, 1.0);
  EXPECT_EQ(factors_of({3.0, 1.0, 0.5}, 1.0, 1.0).gyro, 1.0);            // gravity turns as fast
  EXPECT_EQ(factors_of(0.01 * slow, kRadiansPerDegree, 1.0).gyro, 1.0);  // slow in any unit
  EXPECT_EQ(factors_of(0.2 * slow, 1e-3, 9.80665e-3).gyro, 1.0);         // milli-g, so mrad/s
  EXPECT_EQ(factors_of(slow, 1e-4, 1.0).gyro, 1.0);                      // too fast for deg/s
}

TEST(DvlPlaceholders, AreInvalidSamples) {
  const TmpDir dir;
  dir.write("mav0/dvl0/data.csv",
            "#timestamp [ns],v_x [mm/s],v_y [mm/s],v_z [mm/s],fom\n"
            "10,100,200,300,0.01\n20,-32768,-32768,-32768,0.01\n30,100,200,-32768,0.01\n"
            "40,100,200,300,10\n50,0,0,0,0.01\n");
  std::vector<bool> valid;
  for (const auto& event : read_dataset(config_for(dir.path())).events) {
    valid.push_back(std::get<DvlSample>(event).valid);
  }
  EXPECT_THAT(valid, testing::ElementsAre(true, false, false, false, false));
}

TEST(DvlFlags, OtherWordsAreMalformedWithTheirReason) {
  const TmpDir dir;
  dir.write("mav0/dvl0/data.csv",
            "#timestamp [ns],v_x,v_y,v_z,valid\n10,1,2,3,A\n20,1,2,3,V\n30,1,2,3,y\n40,1,2,3,4\n");
  testing::internal::CaptureStderr();
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              HasSubstr("data.csv:5: dvl sample dropped: malformed: column valid is not 0 or 1: "
                        "\"4\""));
  ASSERT_EQ(out.delivered("dvl"), 3U);
  EXPECT_TRUE(std::get<DvlSample>(out.events[0]).valid);
  EXPECT_FALSE(std::get<DvlSample>(out.events[1]).valid);
  EXPECT_TRUE(std::get<DvlSample>(out.events[2]).valid);
}

TEST(DvlFlags, WaterTrackIsInvalid) {
  const TmpDir dir;
  dir.write("mav0/dvl0/data.csv",
            "#timestamp [ns],v_x,v_y,v_z,is_valid,tracking_mode\n10,1,2,3,1,bottom\n"
            "20,1,2,3,1,water\n30,1,2,3,0,bottom\n");
  testing::internal::CaptureStderr();
  const auto out = read_dataset(config_for(dir.path()));
  EXPECT_THAT(testing::internal::GetCapturedStderr(), HasSubstr("data.csv:3: water track"));
  std::vector<bool> valid;
  for (const auto& event : out.events) valid.push_back(std::get<DvlSample>(event).valid);
  EXPECT_THAT(valid, testing::ElementsAre(true, false, false));
}

TEST(DvlPlaceholders, FlagsMayBeWords) {
  const TmpDir dir;
  dir.write("mav0/dvl0/data.csv",
            "#timestamp [ns],v_x,v_y,v_z,valid\n10,1,2,3,1.0\n20,1,2,3,0.0\n30,1,2,3,True\n"
            "40,1,2,3,False\n50,1,2,3,nan\n60,0,0,0,\n");
  std::vector<bool> valid;
  for (const auto& event : read_dataset(config_for(dir.path())).events) {
    valid.push_back(std::get<DvlSample>(event).valid);
  }
  EXPECT_THAT(valid, testing::ElementsAre(true, false, true, false, true, false));
}

}  // namespace
}  // namespace apvi
