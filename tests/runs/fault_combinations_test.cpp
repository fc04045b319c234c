// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "core/random.hpp"
#include "core/stopwatch.hpp"
#include "runs/fault_tables.hpp"
#include "runs/run.hpp"
#include "support/dive_folder.hpp"
#include "support/tmp_dir.hpp"

// Faults that people report, composed at random on a good recording. Whatever the recording is, a
// run ends with an error that says why, or with finite poses. A wrong result is never silent.

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using test::FaultyDive;

constexpr int kCombinations = 500;
constexpr std::size_t kMaxFaults = 4;
constexpr double kMaxSeconds = 20.0;  // of a run that takes 0.02 s
// The dive is 9 m long, and the error without faults 0.02 m.
constexpr double kRightResult_m = 0.3;

FaultyDive good_dive() {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {.duration_s = 16.0});
  const fs::path mav = tmp.path() / "dive/mav0";
  return {test::FaultTable::read(mav / "imu0/data.csv"),
          test::FaultTable::read(mav / "dvl0/data.csv"),
          test::FaultTable::read(mav / "depth0/data.csv"),
          test::FaultTable::read(mav / "state_groundtruth_estimate0/data.csv")};
}

void write_tables(const FaultyDive& dive, const fs::path& folder) {
  const fs::path mav = folder / "mav0";
  dive.imu.write(mav / "imu0/data.csv");
  dive.dvl.write(mav / "dvl0/data.csv");
  dive.depth.write(mav / "depth0/data.csv");
  dive.truth.write(mav / "state_groundtruth_estimate0/data.csv");
}

struct Outcome {
  std::string error;
  std::size_t remarks = 0;  ///< warnings in the log
  std::optional<double> ate_m;
  Trajectory trajectory;
  double seconds = 0.0;
};

std::size_t count_warnings(const fs::path& log) {
  std::ifstream in(log);
  std::size_t count = 0;
  for (std::string line; std::getline(in, line);) {
    count += line.find("warning") != std::string::npos ? 1 : 0;
  }
  return count;
}

Outcome outcome_of(const fs::path& recording, const fs::path& folder) {
  Outcome outcome;
  RunConfig config;
  config.dataset.path = recording.string();
  const Stopwatch watch;
  try {
    const RunResult result = run(config, {.folder = folder, .overwrite = true});
    if (result.metrics.fused.ate.value) outcome.ate_m = result.metrics.fused.ate.value->rmse;
    outcome.trajectory = io::read_trajectory(folder / "trajectory.tum");
  } catch (const Error& e) {
    outcome.error = e.what();
  }
  outcome.seconds = watch.seconds();
  outcome.remarks = count_warnings(folder / "log.txt");
  return outcome;
}

// Without an error: finite poses in order, and either a right result or a warning.
void check(const Outcome& outcome, bool harmless) {
  EXPECT_LT(outcome.seconds, kMaxSeconds);
  if (!outcome.error.empty()) {
    EXPECT_FALSE(harmless) << outcome.error;
    return;
  }
  const auto& poses = outcome.trajectory.poses;
  EXPECT_FALSE(poses.empty());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    ASSERT_TRUE(poses[i].T_world_body.translation.allFinite() &&
                poses[i].T_world_body.rotation.coeffs().allFinite());
    ASSERT_TRUE(i == 0 || poses[i - 1].stamp < poses[i].stamp);
  }
  const bool is_right = outcome.ate_m && *outcome.ate_m < kRightResult_m;
  EXPECT_TRUE(is_right || outcome.remarks > 0)
      << "ATE " << outcome.ate_m.value_or(-1.0) << " m, and nothing was said";
  EXPECT_TRUE(is_right || !harmless) << "ATE " << outcome.ate_m.value_or(-1.0) << " m";
}

class FaultCombinations : public testing::Test {
 public:
  FaultCombinations() {
    log::set_console_level(log::Level::error);
    test::write_dive(tmp_, "dive", {.duration_s = 16.0});
  }
  ~FaultCombinations() override { log::set_console_level(log::Level::info); }

 protected:
  void run_with(const std::set<std::size_t>& chosen, Random random) {
    FaultyDive dive = good_;
    bool harmless = true;
    std::string names;
    for (const std::size_t i : chosen) {
      faults_[i].apply(dive, random);
      harmless = harmless && faults_[i].is_harmless;
      names += "[" + faults_[i].name + "] ";
    }
    SCOPED_TRACE(names);
    write_tables(dive, tmp_.path() / "dive");
    check(outcome_of(tmp_.path() / "dive", tmp_.path() / "run"), harmless);
  }

  const test::TmpDir tmp_;
  const FaultyDive good_ = good_dive();
  const std::vector<test::Fault> faults_ = test::all_faults();
};

TEST_F(FaultCombinations, AGoodRecordingGivesARightResult) {
  run_with({}, Random(1));
}

TEST_F(FaultCombinations, EachFaultAloneIsHandled) {
  for (std::size_t i = 0; i < faults_.size(); ++i) run_with({i}, Random(i));
}

TEST_F(FaultCombinations, FaultsTogetherAreNeitherFatalNorSilent) {
  Random random(20'261'127);
  for (int k = 0; k < kCombinations && !HasFatalFailure(); ++k) {
    std::set<std::size_t> chosen;
    const auto count = 2 + static_cast<std::size_t>(random.uniform() * (kMaxFaults - 1));
    while (chosen.size() < count) {
      chosen.insert(
          static_cast<std::size_t>(random.uniform() * static_cast<double>(faults_.size())));
    }
    run_with(chosen, random.fork(static_cast<std::uint64_t>(k)));
  }
}

}  // namespace
}  // namespace apvi::runs
