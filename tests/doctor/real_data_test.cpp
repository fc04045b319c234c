// SPDX-License-Identifier: BSD-3-Clause
// Known problems of real recordings.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "doctor/dive.hpp"
#include "support/run_program.hpp"
#include "support/test_data.hpp"

namespace apvi::doctor {
namespace {

using test::value_of;

Report examine_folder(const std::filesystem::path& path) {
  io::DatasetConfig config;
  config.path = path.string();
  return examine(config);
}

class Akit : public testing::TestWithParam<const char*> {};

TEST_P(Akit, DvlCalibrationDiffersBetweenImuAndReference) {
  APVI_NEEDS_DATA(path, GetParam());
  const Report report = examine_folder(path);
  EXPECT_EQ(report.count(Severity::error), 0u) << to_text(report);
  EXPECT_NEAR(value_of(report, "dvl0", "time, imu", "time_offset_s"), -0.025, 0.025);
  EXPECT_NEAR(value_of(report, "dvl0", "lever arm", "x_m"), -0.08, 0.05);
  EXPECT_NEAR(value_of(report, "dvl0", "lever arm", "y_m"), -0.02, 0.05);
  EXPECT_NEAR(value_of(report, "dvl0", "lever arm", "z_m"), 0.22, 0.05);
  EXPECT_LT(value_of(report, "dvl0", "time, imu", "rms_m_s"), 0.012);
  EXPECT_NEAR(value_of(report, "dvl0", "time, reference", "time_offset_s"), 0.45, 0.1);
  EXPECT_FINDING(report, "dvl0", "time, reference", warning, "(30-100 s baselines)");
  EXPECT_FINDING(report, "dvl0", "time, reference", warning, "made with other DVL timing");
  EXPECT_FINDING(report, "dvl0", "lever arm", warning, "the rig says (-1.84, -0.04, 0.11)");
}

INSTANTIATE_TEST_SUITE_P(Runs, Akit,
                         testing::Values("akit_01", "akit_02", "akit_03", "akit_04", "akit_05",
                                         "akit_06"));

class Sonia : public testing::TestWithParam<const char*> {};

TEST_P(Sonia, DvlIsLeftHandedRotatedAndDelayed) {
  APVI_NEEDS_DATA(path, GetParam());
  const Report report = examine_folder(path);
  EXPECT_FINDING(report, "dvl0", "mounting", error, "left-handed, signs (1, 1, -1)");
  EXPECT_NEAR(value_of(report, "dvl0", "mounting", "turn_deg"), 90.0, 5.0);
  EXPECT_NEAR(value_of(report, "dvl0", "time, imu", "time_offset_s"), 0.1, 0.03);
}

INSTANTIATE_TEST_SUITE_P(Runs, Sonia, testing::Values("sonia_pool_square", "sonia_pool_circle"));

TEST(Blueye, ImuSamplesRepeatAndRotatedBeamsAgreeWithRig) {
  APVI_NEEDS_DATA(path, "blueye_auto_square");
  const Report report = examine_folder(path);
  EXPECT_EQ(report.count(Severity::error), 0u) << to_text(report);
  EXPECT_FINDING(report, "imu0", "repeats", warning, "repeat the previous one");
  EXPECT_FINDING(report, "dvl0", "beams, velocity", ok, "agree");
  EXPECT_LT(value_of(report, "dvl0", "beam parity", "rms_m_s"), 0.006);
  EXPECT_NEAR(value_of(report, "dvl0", "time, imu", "time_offset_s"), 0.1, 0.1);
}

TEST(Euroc, FindsWhatWasPutIntoTheSynthesizedDvl) {
  APVI_NEEDS_DATA(path, "euroc_mh01_apvi");
  const Report report = examine_folder(path);
  EXPECT_EQ(report.count(Severity::error), 0u) << to_text(report);
  EXPECT_FINDING(report, "cam0", "size", ok, "752x480");
  EXPECT_NEAR(value_of(report, "dvl0", "time, imu", "time_offset_s"), 0.1, 0.02);
  EXPECT_EQ(report.find("dvl0", "lever arm")->severity, Severity::ok);
  EXPECT_EQ(report.find("dvl0", "mounting")->severity, Severity::ok);
}

TEST(Euroc, CameraAgreesWithTheGyro) {
  APVI_NEEDS_DATA(path, "euroc_mh01_apvi");
  const Report report = examine_folder(path);
  EXPECT_NEAR(value_of(report, "cam0", "gyro", "time_offset_s"), 0.0, 0.002);
  EXPECT_LT(value_of(report, "cam0", "gyro", "turn_deg"), 1.0);
  EXPECT_NEAR(value_of(report, "cam0", "gyro", "gyro_scale"), 1.0, 0.01);
  for (const char* check : {"time, gyro", "mounting", "mirrored", "focal length", "distortion"}) {
    EXPECT_EQ(report.find("cam0", check), nullptr) << to_text(report);
  }
  EXPECT_EQ(report.find("imu0", "gyro scale, cam0"), nullptr) << to_text(report);
}

// The text of a rig with `from` replaced by `to`.
std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

Report examine_with_rig(const std::filesystem::path& path, const std::string& from,
                        const std::string& to) {
  const test::TmpDir dir;
  io::DatasetConfig config;
  config.path = path.string();
  config.rig =
      dir.write("rig.yaml", replaced(test::read_file(path / "rig.yaml"), from, to)).string();
  return examine(config);
}

TEST(Euroc, WrongFocalLengthsAreFound) {
  APVI_NEEDS_DATA(path, "euroc_mh01_apvi");
  const std::string own = "intrinsics: [458.654, 457.296,";
  EXPECT_FINDING(examine_with_rig(path, own, "intrinsics: [435.721, 434.431,"), "cam0",
                 "focal length", warning, "longer than in the rig");
  EXPECT_FINDING(examine_with_rig(path, own, "intrinsics: [481.587, 480.161,"), "cam0",
                 "focal length", warning, "shorter than in the rig");
}

TEST(Reef, TimeOffsetOfTheImagesIsFound) {
  APVI_NEEDS_DATA(path, "reef_gopro");
  const Report report = examine_with_rig(path, "time_offset_s: 0.105", "time_offset_s: 0.0");
  EXPECT_FINDING(report, "cam0", "time, gyro", warning, "set cam0.time_offset_s: 0.10");
  EXPECT_NEAR(value_of(report, "cam0", "time, gyro", "time_offset_s"), 0.105, 0.005);
  EXPECT_EQ(report.find("imu0", "gyro scale, cam0"), nullptr) << to_text(report);
}

}  // namespace
}  // namespace apvi::doctor
