// SPDX-License-Identifier: BSD-3-Clause
#include "eval/sweep_summary.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace apvi::eval {
namespace {

using State = SweepRow::State;
using testing::HasSubstr;
using testing::Not;

SweepRow row(const std::string& name, int seed, double ate) {
  return {.group = name,
          .choices = {{"case", name}},
          .seed = seed,
          .state = State::done,
          .reason = {},
          .metrics = {{"trajectory.ate_rmse_m", ate}}};
}

TEST(Flatten, FlattensNumbersAndListMeansAndMaxima) {
  const Json json = Json::parse(
      R"({"trajectory": {"ate_rmse_m": 0.5, "vio": {"matched": 3}}, "vio": {"success": true,
          "reinit_times_s": [1.0, 4.0, 4.0], "none": []}, "build": {"git": "abc"}})");
  const auto numbers = flatten(json);
  ASSERT_EQ(numbers.size(), 5U);
  EXPECT_EQ(numbers[0], (std::pair<std::string, double>("trajectory.ate_rmse_m", 0.5)));
  EXPECT_EQ(numbers[1].first, "trajectory.vio.matched");
  EXPECT_EQ(numbers[2], (std::pair<std::string, double>("vio.success", 1.0)));
  EXPECT_EQ(numbers[3], (std::pair<std::string, double>("vio.reinit_times_s.mean", 3.0)));
  EXPECT_EQ(numbers[4], (std::pair<std::string, double>("vio.reinit_times_s.max", 4.0)));
}

TEST(SweepTable, ShowsMeanAndSampleDeviationOverSeeds) {
  const std::string table =
      sweep_table({row("full", 1, 0.1), row("full", 2, 0.2), row("full", 3, 0.3)}, {});
  EXPECT_THAT(table, HasSubstr("| case | finished | trajectory.ate_rmse_m |\n|---|---|---|\n"));
  EXPECT_THAT(table, HasSubstr("| full | 3/3 | 0.2 ± 0.1 |\n"));
  EXPECT_THAT(table, Not(HasSubstr("Failed")));
}

TEST(SweepTable, SingleSeedHasNoDeviationAndMissingValuesAreCounted) {
  SweepRow without = row("some", 2, 0.0);
  without.metrics.clear();
  const std::string table =
      sweep_table({row("one", 1, 0.25), row("some", 1, 0.5), without}, {"trajectory.ate_rmse_m"});
  EXPECT_THAT(table, HasSubstr("| one | 1/1 | 0.25 |\n"));
  EXPECT_THAT(table, HasSubstr("| some | 2/2 | 0.5 (1) |\n"));
}

TEST(SweepTable, FailuresAreListedAndExcludedFromMean) {
  SweepRow failed = row("full", 2, 99.0);
  failed.state = State::failed;
  failed.reason = "exit status 1: no pose was estimated";
  const std::string table = sweep_table({row("full", 1, 0.5), failed}, {});
  EXPECT_THAT(table, HasSubstr("| full | 1/2 | 0.5 |\n"));
  EXPECT_THAT(table, HasSubstr("* full, seed 2: exit status 1: no pose was estimated\n"));
}

TEST(SweepTable, EscapesBarsInNames) {
  EXPECT_THAT(sweep_table({row("a|b", 1, 1.0)}, {}), HasSubstr("| a\\|b | 1/1 |"));
}

TEST(SweepCsv, ContainsAllCasesAndMetrics) {
  SweepRow failed = row("b", 1, 0.0);
  failed.state = State::failed;
  failed.reason = "exit status 2: a, \"b\"";
  failed.metrics.clear();
  SweepRow open = row("c", 1, 0.0);
  open.state = State::open;
  open.metrics = {{"speed.wall_s", 2.0}};
  EXPECT_EQ(sweep_csv({row("a", 1, 0.125), failed, open}),
            "group,seed,state,reason,case,trajectory.ate_rmse_m,speed.wall_s\n"
            "a,1,done,,a,0.125,\n"
            "b,1,failed,\"exit status 2: a, \"\"b\"\"\",b,,\n"
            "c,1,open,,c,,2\n");
}

}  // namespace
}  // namespace apvi::eval
