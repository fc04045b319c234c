// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "core/stopwatch.hpp"
#include "runs/playback_clock.hpp"
#include "runs/run.hpp"
#include "support/dive_folder.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr std::int64_t kSecond = 1'000'000'000;

// Moves the rows from `at_s` on by `pause_s`.
void delay_rows(const fs::path& file, std::int64_t from_ns, std::int64_t pause_ns) {
  std::ifstream in(file);
  std::ostringstream out;
  std::string line;
  std::getline(in, line);
  out << line << '\n';
  while (std::getline(in, line)) {
    const std::size_t comma = line.find(',');
    const std::int64_t ns = std::stoll(line.substr(0, comma));
    out << (ns >= from_ns ? ns + pause_ns : ns) << line.substr(comma) << '\n';
  }
  std::ofstream(file) << out.str();
}

// A dive of 40 s whose clock jumps in the middle.
RunConfig paused_dive(const test::TmpDir& tmp, std::int64_t pause_s) {
  test::write_dive(tmp, "dive", {.duration_s = 40.0});
  const fs::path mav = tmp.path() / "dive/mav0";
  std::ifstream imu(mav / "imu0/data.csv");
  std::string line;
  std::getline(imu, line);
  std::getline(imu, line);
  const std::int64_t start = std::stoll(line);
  for (const char* sensor : {"imu0", "dvl0", "depth0", "state_groundtruth_estimate0"}) {
    delay_rows(mav / sensor / "data.csv", start + 20 * kSecond, pause_s * kSecond);
  }
  RunConfig config;
  config.dataset.path = (tmp.path() / "dive").string();
  return config;
}

TEST(Pause, IsOneWarningThatSaysWhenAndHowLong) {
  const test::TmpDir tmp;
  const RunResult result = run(paused_dive(tmp, 300), {.folder = tmp.path() / "run"});
  EXPECT_THAT(result.warnings,
              ElementsAre(AllOf(HasSubstr("no samples for 300.0 s after 19.99 s"))));
  const RunResult whole = run(paused_dive(tmp, 0), {.folder = tmp.path() / "whole"});
  EXPECT_NEAR(result.sequence_s, whole.sequence_s, 0.1);  // without the pause
  EXPECT_LT(result.metrics.fused.ate.value->rmse, 1.0);
}

TEST(Pause, OfYearsIsNotWaitedForInRealTime) {
  const test::TmpDir tmp;
  RunConfig config = paused_dive(tmp, 1'400'000'000);
  config.run.mode = localization::RunMode::realtime;
  config.run.playback_rate = 100.0;
  const RunResult result = run(config, {.folder = tmp.path() / "run"});
  EXPECT_GT(result.wall_s, 0.3);
  EXPECT_LT(result.wall_s, 20.0);
  EXPECT_THAT(result.warnings, ElementsAre(HasSubstr("clock was set")));
}

TEST(PlaybackClock, AWaitEndsWhenInterrupted) {
  PlaybackClock clock(0.01, 100.0);
  const Stopwatch watch;
  int polls = 0;
  const auto interrupted = [&polls] { return ++polls > 2; };
  clock.wait(Stamp{0}, interrupted);
  clock.wait(Stamp{10 * kSecond}, interrupted);  // due after 1000 s
  EXPECT_LT(watch.seconds(), 10.0);
  EXPECT_EQ(polls, 3);
}

}  // namespace
}  // namespace apvi::runs
