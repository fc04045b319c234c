// SPDX-License-Identifier: BSD-3-Clause
// The commands `apvi import` and `apvi run SOURCE`.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "importer/source_files.hpp"
#include "importer/vehicle_bytes.hpp"

namespace apvi::importer {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

test::ProgramResult apvi(const std::vector<std::string>& arguments) {
  return test::run_program(APVI_PROGRAM, arguments);
}

TEST(ImportCommand, MakesAFolderAndSaysWhatIsAssumed) {
  const test::TmpDir dir;
  test::write_photo(dir, "photos/a.png");
  const fs::path dive = dir.path() / "dive";
  const auto result =
      apvi({"import", (dir.path() / "photos").string(), "-o", dive.string(), "--fov", "80"});
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_THAT(result.err, HasSubstr("ASSUMED, not calibrated: horizontal field of view 80.0"));
  EXPECT_THAT(result.err, HasSubstr("photographs can be localized only if"));
  EXPECT_TRUE(fs::exists(dive / "rig.yaml"));
}

TEST(ImportCommand, MissingSourceIsAnInputError) {
  const auto result = apvi({"import", "/nowhere/clip.mp4", "-o", "/nowhere/dive"});
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, HasSubstr("/nowhere/clip.mp4: no such file"));
}

TEST(ImportCommand, BrokenVideoIsReportedOnce) {
  const test::TmpDir dir;
  const fs::path video = dir.write("clip.mp4", "");
  const auto result = apvi({"import", video.string(), "-o", (dir.path() / "dive").string()});
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.err,
            "error: " + video.string() +
                ": not a video that this OpenCV can read; convert it to H.264 in MP4\n");
}

TEST(ImportCommand, FolderThatCannotBeCreatedIsARunError) {
  const test::TmpDir dir;
  test::write_photo(dir, "photos/a.png");
  dir.write("file", "x");
  const auto result =
      apvi({"import", (dir.path() / "photos").string(), "-o", (dir.path() / "file/dive").string()});
  EXPECT_EQ(result.status, 1);
  EXPECT_THAT(result.err, HasSubstr("cannot create this folder"));
}

TEST(RunOfSource, OneImageGivesNoPose) {
  const test::TmpDir dir;
  test::write_photo(dir, "photos/a.png");
  const fs::path run = dir.path() / "run";
  const auto result = apvi({"run", (dir.path() / "photos").string(), "-o", run.string()});
  EXPECT_EQ(result.status, 1);
  EXPECT_THAT(result.err, HasSubstr("scale: unknown"));
  EXPECT_THAT(result.err, HasSubstr("no pose was estimated: still waiting for images"));
  EXPECT_TRUE(fs::exists(run / "input/mav0/cam0/data.csv"));
}

TEST(RunOfSource, DoesNotImportIntoTheFolderOfAnotherRun) {
  const test::TmpDir dir;
  test::write_photo(dir, "photos/a.png");
  dir.write("run/trajectory.tum", "");
  const auto result =
      apvi({"run", (dir.path() / "photos").string(), "-o", (dir.path() / "run").string()});
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, HasSubstr("already holds a run"));
  EXPECT_FALSE(fs::exists(dir.path() / "run/input"));
}

// 20 s of a vehicle that moves forward at about 0.25 m/s, with a DVL or without. Sensors whose
// readings never change would be taken for stuck.
std::string log_of_vehicle(bool has_dvl) {
  std::string log = test::dataflash_formats();
  for (std::uint64_t us = 1'000'000; us < 21'000'000; us += 20'000) {
    const float wave = 0.001F * std::sin(1e-6F * static_cast<float>(us));
    log += test::dataflash_imu(us, 0, {wave, -wave, wave, wave, 0.0F, wave - 9.81F});
    if (us % 100'000 == 0) log += test::dataflash_baro(us, 1, 151'350.0F + 1000.0F * wave);
    if (has_dvl && us % 200'000 == 0) {
      log += test::dataflash_viso(us, 0.2F, {0.05F + wave, wave, 0.0F}, 90.0F);
    }
  }
  return log;
}

TEST(RunOfSource, ALogWithADvlGivesATrajectory) {
  const test::TmpDir dir;
  const fs::path log = dir.write("dive.BIN", log_of_vehicle(true));
  const fs::path run = dir.path() / "run";
  const auto result = apvi({"run", log.string(), "-o", run.string(), "--no-report"});
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_TRUE(fs::exists(run / "trajectory.tum"));
}

TEST(RunOfSource, ALogWithoutADvlSaysWhatIsMissing) {
  const test::TmpDir dir;
  const fs::path log = dir.write("dive.BIN", log_of_vehicle(false));
  const auto result = apvi({"run", log.string(), "-o", (dir.path() / "run").string()});
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, HasSubstr("no velocities of a DVL"));
  EXPECT_THAT(result.err, HasSubstr("needs a camera, or a DVL and an IMU"));
}

TEST(ImportCommand, VideoStartMustBeATime) {
  const auto result = apvi({"import", "clip.mp4", "--video-start", "noon", "-o", "dive"});
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, HasSubstr("--video-start: noon: not a time"));
}

}  // namespace
}  // namespace apvi::importer
