// SPDX-License-Identifier: BSD-3-Clause
// What the program `apvi` says about its arguments.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <filesystem>

#include "support/run_program.hpp"

namespace apvi::cli {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::MatchesRegex;
using testing::Not;
using testing::StartsWith;

test::ProgramResult apvi(const std::vector<std::string>& arguments) {
  return test::run_program(APVI_PROGRAM, arguments);
}

// The messages of a command that refuses its arguments.
std::string error_of(const std::vector<std::string>& arguments) {
  const auto result = apvi(arguments);
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.out, "");
  return result.err;
}

TEST(Arguments, UnknownCommandHasASuggestion) {
  EXPECT_EQ(error_of({"rum"}), "error: unknown command rum; did you mean run?\n");
  EXPECT_EQ(error_of({"runs", "--help"}), "error: unknown command runs; did you mean run?\n");
  EXPECT_EQ(error_of({"-v", "evl"}), "error: unknown command evl; did you mean eval?\n");
  EXPECT_THAT(error_of({"xyzzy"}),
              StartsWith("error: unknown command xyzzy; the commands are run, live, eval, "));
}

TEST(Arguments, ErrorsHaveOneFormAndNameTheHelp) {
  EXPECT_EQ(error_of({"-q"}), "error: a subcommand is required; see apvi --help\n");
  EXPECT_EQ(error_of({"run"}), "error: DIVE|CONFIG is required; see apvi run --help\n");
  EXPECT_EQ(error_of({"run", "dive", "--foo"}),
            "error: the following argument was not expected: --foo; see apvi run --help\n");
}

TEST(Arguments, HelpAndVersionAreNoErrors) {
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"--help"}, {"run", "--help"}, {"-v", "--version"}}) {
    const auto result = apvi(arguments);
    EXPECT_EQ(result.status, 0);
    EXPECT_EQ(result.err, "");
  }
  EXPECT_THAT(apvi({"run", "--help"}).out, HasSubstr("DIVE|CONFIG FILE|FOLDER REQUIRED"));
}

TEST(Arguments, VersionNamesRevisionBackendAndMapping) {
  EXPECT_THAT(apvi({"--version"}).out,
              MatchesRegex("apvi [0-9.]+\ngit revision: [0-9A-Za-z.-]+\n"
                           "backend: (cpu|cuda)\nmapping: (off|on, LibTorch [0-9][0-9.]+.*)\n"));
}

TEST(RunCommand, RefusesFilesThatAreNoRecordingOrConfiguration) {
  const test::TmpDir dir;
  const std::string file = dir.write("a.txt", "hello\n").string();
  EXPECT_EQ(error_of({"run", file}),
            "error: " + file +
                ": not a recording (folder, .bag, .mcap, .db3), video, or configuration (.yaml)\n");
  EXPECT_THAT(error_of({"run", "/nowhere/dive"}),
              StartsWith("error: /nowhere/dive: no such file or folder"));
}

TEST(RunCommand, SaysWhatAFileIsThatItDoesNotRead) {
  const test::TmpDir dir;
  for (const auto& [name, content, kind] : std::vector<std::array<std::string, 3>>{
           {"a.zip", "PK\x03\x04", "a zip archive"},
           {"a.h264", "1234", "a raw video stream"},
           {"a.ksplat", "1234", "a .ksplat map"},
           {"a.bag", "SQLite format 3", "an sqlite3 database: if it is a bag of ROS 2"},
           {"b.bag", "", "an empty file"}}) {
    const std::string file = dir.write(name, content).string();
    EXPECT_THAT(error_of({"run", file}), HasSubstr(file + ": not a recording, but " + kind));
    EXPECT_THAT(error_of({"doctor", file}), HasSubstr(file + ": not a recording, but " + kind));
    EXPECT_THAT(error_of({"import", file, "-o", (dir.path() / "out").string()}),
                HasSubstr(file + ": cannot be imported: " + kind));
  }
}

TEST(RunCommand, SaysThatAFolderOrARigIsEmpty) {
  const test::TmpDir dir;
  std::filesystem::create_directories(dir.path() / "empty");
  const std::string empty = (dir.path() / "empty").string();
  EXPECT_EQ(error_of({"run", empty}),
            "error: " + empty + ": no data set in this folder, which is empty\n");
  const std::string imu = "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n1,0,0,0,0,0,9.8\n";
  dir.write("archive/dive/mav0/imu0/data.csv", imu);
  const std::string rig = dir.write("archive/dive/rig.yaml", "# nothing yet\n").string();
  EXPECT_THAT(error_of({"run", (dir.path() / "archive").string()}), HasSubstr("archive/dive\n"));
  EXPECT_THAT(error_of({"run", (dir.path() / "archive/dive").string()}),
              HasSubstr(rig + ": empty; describe the sensors in it"));
}

TEST(RunCommand, ErrorsOfTheFileSystemAreMessages) {
  const test::TmpDir dir;
  dir.write("dive/mav0/imu0/data.csv", "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n1,0,0,0,0,0,9\n");
  dir.write("dive/mav0/dvl0/data.csv", "#timestamp [ns],v_x,v_y,v_z\n1,0,0,0\n");
  dir.write("dive/rig.yaml", "imu0: {}\ndvl0: {}\n");
  const std::string file = dir.write("file", "in the way").string();
  const auto result = apvi({"run", (dir.path() / "dive").string(), "-o", file + "/run"});
  EXPECT_NE(result.status, 0);
  EXPECT_LT(result.status, 3);
  EXPECT_THAT(result.err, HasSubstr("error: " + file));
  EXPECT_THAT(result.err, Not(HasSubstr("filesystem error")));
}

TEST(RunCommand, NamesTheOptionForTheRecording) {
  const test::TmpDir dir;
  for (const char* name : {"own.yaml", "own.yml", "own.job", "own"}) {
    const std::string file = dir.write(name, "run: {seed: 1}\n").string();
    EXPECT_EQ(error_of({"run", file}),
              "error: " + file +
                  ": dataset.path: missing; name the recording: --set dataset.path=RECORDING\n");
  }
}

TEST(RunCommand, ErrorsOfOverridesNameTheKeyOnce) {
  const test::TmpDir dir;
  const std::string file = dir.write("own.yaml", "run: {seed: 1}\n").string();
  EXPECT_EQ(error_of({"run", file, "--set", "mapping.max_gaussians=abc"}),
            "error: --set: mapping.max_gaussians: expected a whole number, got abc\n");
  EXPECT_EQ(
      error_of({"run", file, "--set", "mapping.max_gausians=5"}),
      "error: --set: unknown key mapping.max_gausians; did you mean mapping.max_gaussians?\n");
}

TEST(DiffCommand, NamesWhatIsMissing) {
  if (apvi({"--version"}).out.find("mapping: off") != std::string::npos) {
    GTEST_SKIP() << "this build has no mapping";
  }
  const test::TmpDir dir;
  EXPECT_THAT(error_of({"diff", "/nowhere/a", "/nowhere/b", "-o", (dir.path() / "c").string()}),
              StartsWith("error: /nowhere/a: no such folder"));
  const std::string empty = dir.write("a/log.txt", "").parent_path().string();
  EXPECT_THAT(error_of({"diff", empty, empty, "-o", (dir.path() / "c").string()}),
              HasSubstr("has no resolved.yaml; expected the folder of a run with a map"));
  EXPECT_EQ(error_of({"diff", empty, empty}),
            "error: --output is required; see apvi diff --help\n");
}

TEST(ConfigCommand, CountsInvalidFiles) {
  const test::TmpDir dir;
  const std::string good = dir.write("good.yaml", "run: {seed: 1}\n").string();
  const std::string bad = dir.write("bad.yaml", "run: {sead: 1}\n").string();
  const auto result = apvi({"config", "--check", good, bad});
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.out, good + ": ok (run configuration)\n");
  EXPECT_THAT(result.err, HasSubstr("bad.yaml:1: unknown key run.sead; did you mean run.seed?"));
  EXPECT_THAT(result.err, EndsWith("error: 1 of 2 files invalid\n"));
}

}  // namespace
}  // namespace apvi::cli
