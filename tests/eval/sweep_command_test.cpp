// SPDX-License-Identifier: BSD-3-Clause
// The command `apvi sweep`: folders, tables, resuming, failures, Ctrl-C.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "core/child_process.hpp"
#include "core/stopwatch.hpp"
#include "support/dive_folder.hpp"
#include "support/run_program.hpp"
#include "support/source_dir.hpp"

namespace apvi {
namespace {

namespace fs = std::filesystem;
using test::ProgramResult;
using test::read_file;
using testing::HasSubstr;
using testing::Not;

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t n = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++n;
  return n;
}

class SweepCommand : public testing::Test {
 protected:
  explicit SweepCommand(double dive_s = 12.0) {
    test::write_dive(dir_, "dive", {.duration_s = dive_s});
    dir_.write("base.yaml", "dataset: {path: " + (dir_.path() / "dive").string() + "}\n");
  }
  ProgramResult sweep(const std::string& text, const std::vector<std::string>& more = {}) const {
    const fs::path file = dir_.write("sweep.yaml", text);
    std::vector<std::string> arguments = {"sweep", file.string(), "-o", out_.string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return test::run_program(APVI_PROGRAM, arguments);
  }

  test::TmpDir dir_;
  fs::path out_ = dir_.path() / "out";
};

const std::string kFour =
    "base: base.yaml\n"
    "cases: {both: {}, without_depth: {sensors.use: [imu, dvl]}}\n"
    "seeds: 2\n";

TEST_F(SweepCommand, RunsAllCasesAndWritesTable) {
  const ProgramResult result = sweep(kFour, {"-j", "2"});
  EXPECT_EQ(result.status, 0) << result.err;
  for (const char* name : {"both/seed-1", "both/seed-2", "without_depth/seed-1"}) {
    EXPECT_TRUE(fs::exists(out_ / name / "metrics.json")) << name;
    EXPECT_TRUE(fs::exists(out_ / name / "trajectory.tum")) << name;
  }
  EXPECT_THAT(result.out, HasSubstr("| case | finished | trajectory.ate_rmse_m |"));
  EXPECT_THAT(result.out, HasSubstr("| both | 2/2 |"));
  EXPECT_THAT(result.out, HasSubstr("| without_depth | 2/2 |"));
  EXPECT_EQ(read_file(out_ / "summary.md"), result.out);
  const std::string csv = read_file(out_ / "summary.csv");
  EXPECT_EQ(count(csv, "\n"), 5U);
  EXPECT_EQ(count(csv, ",done,"), 4U);
}

TEST_F(SweepCommand, SkipsFinishedCases) {
  sweep(kFour);
  const auto first = fs::last_write_time(out_ / "both/seed-1/metrics.json");
  const ProgramResult again = sweep(kFour);
  EXPECT_EQ(again.status, 0);
  EXPECT_THAT(again.err, HasSubstr("4 cases, 4 already finished"));
  EXPECT_EQ(fs::last_write_time(out_ / "both/seed-1/metrics.json"), first);
  EXPECT_THAT(again.out, HasSubstr("| both | 2/2 |"));
}

TEST_F(SweepCommand, RerunsOnlyChangedCases) {
  sweep(kFour);
  const ProgramResult changed = sweep(
      "base: base.yaml\n"
      "cases: {both: {}, without_depth: {sensors.use: [imu, dvl], localization.gravity: 9.81}}\n"
      "seeds: 2\n");
  EXPECT_THAT(changed.err, HasSubstr("4 cases, 2 already finished"));
  EXPECT_THAT(changed.err, Not(HasSubstr("both/seed-1: started")));
  EXPECT_THAT(changed.err, HasSubstr("without_depth/seed-1: started"));
  fs::remove(out_ / "both/seed-2/metrics.json");
  EXPECT_THAT(sweep(kFour).err, HasSubstr("both/seed-2: started"));
}

TEST_F(SweepCommand, FailedCaseIsReportedAndRetried) {
  const std::string text =
      "base: base.yaml\n"
      "cases: {good: {}, gone: {dataset.path: " +
      (dir_.path() / "nowhere").string() + "}}\n";
  const ProgramResult result = sweep(text);
  EXPECT_EQ(result.status, 1);
  EXPECT_THAT(result.err, HasSubstr("1 of 2 cases failed"));
  EXPECT_THAT(result.out, HasSubstr("| good | 1/1 |"));
  EXPECT_THAT(result.out, HasSubstr("| gone | 0/1 |"));
  EXPECT_THAT(result.out, HasSubstr("* gone: exit status 2: "));
  EXPECT_THAT(read_file(out_ / "summary.csv"), HasSubstr("gone,,failed,"));
  const ProgramResult again = sweep(text);
  EXPECT_THAT(again.err, HasSubstr("2 cases, 1 already finished"));
  test::write_dive(dir_, "nowhere", {.duration_s = 12.0});
  EXPECT_EQ(sweep(text).status, 0);
}

TEST_F(SweepCommand, RunsSeveralFilesInSeparateFolders) {
  const std::string first = dir_.write("first.yaml", kFour).string();
  const std::string second = dir_.write("second.yaml", "base: base.yaml\n").string();
  const auto both = [&] {
    return test::run_program(APVI_PROGRAM, {"sweep", first, second, "-o", out_.string()});
  };
  const ProgramResult result = both();
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_TRUE(fs::exists(out_ / "first/both/seed-1/metrics.json"));
  EXPECT_TRUE(fs::exists(out_ / "second/summary.md"));
  EXPECT_THAT(both().err, HasSubstr("1 cases, 1 already finished"));
  dir_.write("second.yaml", "base: base.yaml\nset: {dipo.gravitation: 9.81}\n");
  fs::remove_all(out_);
  EXPECT_EQ(both().status, 2);
  EXPECT_FALSE(fs::exists(out_ / "first/both"));
}

TEST_F(SweepCommand, ReportsInvalidCaseBeforeStarting) {
  const ProgramResult result =
      sweep("base: base.yaml\ncases: {good: {}, bad: {dipo.gravitation: 9.81}}\n");
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, HasSubstr("dipo.gravitation"));
  EXPECT_FALSE(fs::exists(out_ / "good"));
}

TEST_F(SweepCommand, ParallelJobsGiveSameTable) {
  const std::string text = kFour + "columns: [trajectory.ate_rmse_m, trajectory.path_length_m]\n";
  const std::string one = sweep(text).out;
  fs::remove_all(out_);
  EXPECT_EQ(sweep(text, {"-j", "3"}).out, one);
}

TEST_F(SweepCommand, RunsSimulations) {
  dir_.write("scene.yaml",
             fmt::format("inherit: {}\n",
                         (test::source_dir() / "configs/scenes/seabed_easy.yaml").string()));
  const std::string text =
      "command: sim\nbase: scene.yaml\nset: {duration_s: 3, camera.enabled: false}\nseeds: [4]\n";
  const ProgramResult result = sweep(text);
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_TRUE(fs::exists(out_ / "sweep/seed-4/rig.yaml"));
  EXPECT_THAT(sweep(text).err, HasSubstr("1 cases, 1 already finished"));
}

class LongSweepCommand : public SweepCommand {
 protected:
  LongSweepCommand() : SweepCommand(300.0) {}
};

TEST_F(LongSweepCommand, CtrlCKeepsFinishedCasesAndCommandResumes) {
  const std::string text = "base: base.yaml\nseeds: 6\n";
  const fs::path file = dir_.write("sweep.yaml", text);
  ChildProcess child({APVI_PROGRAM, "sweep", file.string(), "-o", out_.string()},
                     dir_.path() / "log");
  const Stopwatch watch;
  const auto nap = [] { std::this_thread::sleep_for(std::chrono::milliseconds(5)); };
  while (!fs::exists(out_ / "cases/sweep/seed-1.done") && watch.seconds() < 60.0) nap();
  child.stop();
  std::optional<ChildExit> exit;
  while (!(exit = child.poll()) && watch.seconds() < 120.0) nap();
  ASSERT_TRUE(exit);
  EXPECT_EQ(exit->status, 1);
  EXPECT_THAT(read_file(dir_.path() / "log"), HasSubstr("run the same command to continue"));
  EXPECT_FALSE(fs::exists(out_ / "cases/sweep/seed-6.done"));
  EXPECT_THAT(read_file(out_ / "summary.csv"), HasSubstr("sweep,6,open,"));
  const auto first = fs::last_write_time(out_ / "sweep/seed-1/metrics.json");
  const ProgramResult rest = sweep(text);
  EXPECT_EQ(rest.status, 0) << rest.err;
  EXPECT_EQ(fs::last_write_time(out_ / "sweep/seed-1/metrics.json"), first);
  EXPECT_THAT(rest.out, HasSubstr("| sweep | 6/6 |"));
}

}  // namespace
}  // namespace apvi
