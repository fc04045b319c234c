// SPDX-License-Identifier: BSD-3-Clause
// The commands `apvi import` and `apvi run SOURCE`.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "importer/source_files.hpp"

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

}  // namespace
}  // namespace apvi::importer
