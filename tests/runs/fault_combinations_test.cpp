// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <set>

#include "apvi/core/error.hpp"
#include "apvi/core/log.hpp"
#include "apvi/io/tum.hpp"
#include "core/random.hpp"
#include "core/stopwatch.hpp"
#include "core/text.hpp"
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

constexpr int kCombinations = 400;
constexpr int kBagCombinations = 60;
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

struct Outcome {
  std::string error;
  std::vector<std::string> warnings;  ///< of the log, in lower case
  std::optional<double> ate_m;
  Trajectory trajectory;
  double seconds = 0.0;
};

std::vector<std::string> read_warnings(const fs::path& log) {
  std::ifstream in(log);
  std::vector<std::string> warnings;
  for (std::string line; std::getline(in, line);) {
    const std::size_t at = line.find("warning: ");
    if (at != std::string::npos) warnings.push_back(text::to_lower(line.substr(at + 9)));
  }
  return warnings;
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
  outcome.warnings = read_warnings(folder / "log.txt");
  return outcome;
}

bool speaks_of(const std::string& message, const std::vector<std::string>& names) {
  return std::ranges::any_of(
      names, [&](const std::string& name) { return message.find(name) != std::string::npos; });
}

// Without an error: finite poses in order, and either a right result or a warning. Warnings and
// errors must name what is at fault; `names` is empty for harmless faults.
void check(const Outcome& outcome, const std::vector<std::string>& names) {
  EXPECT_LT(outcome.seconds, kMaxSeconds);
  const bool harmless = names.empty();
  if (!outcome.error.empty()) {
    EXPECT_TRUE(speaks_of(text::to_lower(outcome.error), names)) << outcome.error;
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
  const bool is_said = std::ranges::any_of(
      outcome.warnings, [&](const std::string& warning) { return speaks_of(warning, names); });
  EXPECT_TRUE(is_right || is_said)
      << "ATE " << outcome.ate_m.value_or(-1.0) << " m, and nothing was said of it, but "
      << testing::PrintToString(outcome.warnings);
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
  enum class Container { folder, mcap, db3 };

  void run_with(const std::vector<test::Fault>& faults, const std::set<std::size_t>& chosen,
                Random random, Container container = Container::folder) {
    FaultyDive dive = good_;
    std::vector<std::string> names;
    std::string trace;
    for (const std::size_t i : chosen) {
      faults[i].apply(dive, random);
      names.insert(names.end(), faults[i].names.begin(), faults[i].names.end());
      trace += "[" + faults[i].name + "] ";
    }
    SCOPED_TRACE(trace);
    fs::path recording = tmp_.path() / "dive";
    if (container == Container::folder) {
      dive.write_folder(recording);
    } else if (container == Container::mcap) {
      recording /= "dive.mcap";
      dive.write_mcap(recording);
    } else {
      recording /= "dive.db3";
      dive.write_db3(recording);
    }
    check(outcome_of(recording, tmp_.path() / "run"), names);
  }

  void run_combinations(const std::vector<test::Fault>& faults, int combinations, Random random,
                        Container container) {
    for (int k = 0; k < combinations && !HasFatalFailure(); ++k) {
      std::set<std::size_t> chosen;
      const auto count = 2 + static_cast<std::size_t>(random.uniform() * (kMaxFaults - 1));
      while (chosen.size() < count) {
        chosen.insert(
            static_cast<std::size_t>(random.uniform() * static_cast<double>(faults.size())));
      }
      run_with(faults, chosen, random.fork(static_cast<std::uint64_t>(k)), container);
    }
  }

  const test::TmpDir tmp_;
  const FaultyDive good_ = good_dive();
};

TEST_F(FaultCombinations, AGoodRecordingGivesARightResult) {
  run_with({}, {}, Random(1));
  run_with({}, {}, Random(1), Container::mcap);
  run_with({}, {}, Random(1), Container::db3);
}

TEST_F(FaultCombinations, EachFaultAloneIsHandled) {
  const auto faults = test::all_faults();
  for (std::size_t i = 0; i < faults.size(); ++i) run_with(faults, {i}, Random(i));
}

TEST_F(FaultCombinations, EachFaultAloneIsHandledInABag) {
  const auto faults = test::bag_faults();
  for (std::size_t i = 0; i < faults.size(); ++i) {
    run_with(faults, {i}, Random(i), Container::mcap);
    run_with(faults, {i}, Random(i), Container::db3);
  }
}

TEST_F(FaultCombinations, FaultsTogetherAreNeitherFatalNorSilent) {
  run_combinations(test::all_faults(), kCombinations, Random(20'261'127), Container::folder);
}

TEST_F(FaultCombinations, FaultsTogetherAreNeitherFatalNorSilentInABag) {
  run_combinations(test::bag_faults(), kBagCombinations, Random(7), Container::mcap);
  run_combinations(test::bag_faults(), kBagCombinations / 2, Random(8), Container::db3);
}

}  // namespace
}  // namespace apvi::runs
