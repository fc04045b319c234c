// SPDX-License-Identifier: BSD-3-Clause
#include "eval/metrics_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

#include "apvi/core/error.hpp"
#include "eval/synthetic_pair.hpp"
#include "support/run_program.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::eval {
namespace {

using testing::HasSubstr;

TrajectoryMetrics example() {
  const auto pair = test::synthetic_pair();
  return evaluate(pair.reference, pair.estimate);
}

TEST(MetricsJson, ContainsAllComputedMetrics) {
  const TrajectoryMetrics m = example();
  const Json json = to_json(m);
  EXPECT_EQ(json.at("ate_rmse_m").get<double>(), m.ate.value->rmse);
  EXPECT_EQ(json.at("ate_first_pose_rmse_m").get<double>(), m.ate_first_pose.value->rmse);
  EXPECT_EQ(json.at("ate_percent_of_path").get<double>(), *m.ate_percent_of_path);
  EXPECT_EQ(json.at("rot_rmse_deg").get<double>(), m.rotation_deg.value->rmse);
  EXPECT_EQ(json.at("rpe_1s_rmse_m").get<double>(), m.rpe_time.value->rmse);
  EXPECT_EQ(json.at("rpe_10m_rmse_m").get<double>(), m.rpe_distance.value->rmse);
  EXPECT_EQ(json.at("coverage").get<double>(), *m.coverage);
  EXPECT_EQ(json.at("path_length_m").get<double>(), *m.path_length_m);
  EXPECT_EQ(json.at("matched").get<std::size_t>(), *m.matched);
  EXPECT_EQ(json.at("end_to_start_m").get<double>(), *m.end_to_start_m);
}

TEST(MetricsJson, OmitsMetricsThatDoNotApply) {
  const auto pair = test::synthetic_pair();
  const Json json = to_json(evaluate_without_reference(pair.estimate));
  EXPECT_EQ(json.size(), 2u);
  EXPECT_TRUE(json.contains("end_to_start_m"));
  EXPECT_TRUE(json.contains("estimate_length_m"));
}

TEST(MetricsJson, ContainsMetricsOfIndividualEstimators) {
  const Json json = to_json(RunTrajectories{.fused = example(), .dipo = example(), .vio = {}});
  EXPECT_TRUE(json.contains("ate_rmse_m"));
  EXPECT_EQ(json.at("dipo").at("ate_rmse_m"), json.at("ate_rmse_m"));
  EXPECT_FALSE(json.contains("vio"));
}

TEST(MetricsFile, MergeReplacesGivenSectionsAndKeepsOthers) {
  const test::TmpDir dir;
  const auto file =
      dir.write("metrics.json", R"({"speed": {"wall_s": 3.5}, "trajectory": {"ate_rmse_m": 9}})");
  merge_metrics(file, {{"trajectory", {{"coverage", 0.5}}}});
  const Json json = read_metrics(file);
  EXPECT_EQ(json.at("speed").at("wall_s").get<double>(), 3.5);
  EXPECT_EQ(json.at("trajectory").dump(), R"({"coverage":0.5})");  // nothing stale
}

TEST(MetricsFile, MergeCreatesMissingFile) {
  const test::TmpDir dir;
  merge_metrics(dir.path() / "metrics.json", {{"trajectory", {{"matched", 3}}}});
  EXPECT_EQ(read_metrics(dir.path() / "metrics.json").at("trajectory").at("matched"), 3);
  const auto entries = std::filesystem::directory_iterator(dir.path());
  EXPECT_EQ(std::distance(begin(entries), end(entries)), 1);
}

TEST(MetricsFile, OmitsNonFiniteNumbers) {
  const test::TmpDir dir;
  const auto file = dir.path() / "metrics.json";
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  merge_metrics(file, {{"vio", {{"init_time_s", kNan}, {"failures", 2}}}});
  EXPECT_EQ(read_metrics(file).dump(), R"({"vio":{"failures":2}})");
}

TEST(MetricsFile, RoundTripsDoublesExactly) {
  const test::TmpDir dir;
  const auto file = dir.path() / "metrics.json";
  merge_metrics(file, {{"speed", {{"wall_s", 0.1 + 0.2}}}});
  EXPECT_EQ(read_metrics(file).at("speed").at("wall_s").get<double>(), 0.1 + 0.2);
}

TEST(MetricsFile, ReportsInvalidFileAndKeepsIt) {
  const test::TmpDir dir;
  const auto file = dir.write("metrics.json", "{\"trajectory\": ");
  EXPECT_THROW(read_metrics(file), InputError);
  try {
    merge_metrics(file, {{"trajectory", Json::object()}});
    FAIL() << "merged into a broken file";
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr(file.string()));
  }
  EXPECT_EQ(test::read_file(file), "{\"trajectory\": ");
}

TEST(MetricsFile, ThrowsRunErrorWhenNotWritable) {
  EXPECT_THROW(merge_metrics("/nonexistent/metrics.json", Json::object()), RunError);
}

TEST(MetricsTable, ShowsReasonForMissingMetric) {
  auto pair = test::synthetic_pair();
  pair.reference.has_rotation = false;
  const std::string table =
      to_table({.fused = evaluate(pair.reference, pair.estimate), .dipo = example(), .vio = {}});
  EXPECT_THAT(table, HasSubstr("fused"));
  EXPECT_THAT(table, HasSubstr("dipo"));
  EXPECT_THAT(table, HasSubstr("- (positions only)"));
  EXPECT_THAT(table, testing::Not(HasSubstr("nan")));
}

TEST(MetricsTable, ShowsOnlyKnownMetricsWithoutReference) {
  const auto pair = test::synthetic_pair();
  const std::string table =
      to_table({.fused = evaluate_without_reference(pair.estimate), .dipo = {}, .vio = {}});
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 2);
  EXPECT_THAT(table, HasSubstr("end to start [m]"));
}

TEST(MetricsTable, NamesNoMetersWhenTheScaleIsUnknown) {
  const auto pair = test::synthetic_pair();
  const std::string table = to_table({.fused = evaluate_without_reference(pair.estimate),
                                      .dipo = {},
                                      .vio = {},
                                      .smoothed = {},
                                      .in_meters = false});
  EXPECT_THAT(table, testing::Not(HasSubstr("[m]")));
}

}  // namespace
}  // namespace apvi::eval
