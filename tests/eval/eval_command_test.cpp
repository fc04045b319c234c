// SPDX-License-Identifier: BSD-3-Clause
// The command `apvi eval`: exit status, standard output, error message.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "apvi/io/tum.hpp"
#include "eval/synthetic_pair.hpp"
#include "eval/trajectory_metrics.hpp"
#include "support/run_program.hpp"

namespace apvi::eval {
namespace {

using nlohmann::json;
using test::ProgramResult;
using testing::HasSubstr;

ProgramResult apvi_eval(std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), "eval");
  return test::run_program(APVI_PROGRAM, arguments);
}

void expect_input_error(const ProgramResult& result, const std::string& what) {
  EXPECT_EQ(result.status, 2);
  EXPECT_EQ(result.out, "");
  EXPECT_THAT(result.err, HasSubstr(what));
  EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
}

class EvalTrajectory : public testing::Test {
 protected:
  EvalTrajectory() : pair_(test::synthetic_pair()) {
    io::write_tum(reference_, pair_.reference);
    io::write_tum(estimate_, pair_.estimate);
  }
  ProgramResult evaluate_files(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments = {"trajectory", "--reference", reference_.string(),
                                          "--estimate", estimate_.string()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return apvi_eval(arguments);
  }

  test::TmpDir dir_;
  test::TrajectoryPair pair_;
  std::filesystem::path reference_ = dir_.path() / "reference.tum";
  std::filesystem::path estimate_ = dir_.path() / "estimate.tum";
};

TEST_F(EvalTrajectory, PrintsTable) {
  const ProgramResult result = evaluate_files();
  EXPECT_EQ(result.status, 0) << result.err;
  EXPECT_EQ(result.err, "");
  EXPECT_THAT(result.out, HasSubstr("ATE RMSE [m]                                 0.3636\n"));
}

TEST_F(EvalTrajectory, JsonOptionPrintsOnlyJson) {
  const ProgramResult result = evaluate_files({"--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  const auto figures = json::parse(result.out).at("trajectory");
  const TrajectoryMetrics expected = evaluate(pair_.reference, pair_.estimate);
  EXPECT_NEAR(figures.at("ate_rmse_m").get<double>(), expected.ate.value->rmse, 1e-8);
  EXPECT_NEAR(figures.at("rpe_1s_rmse_m").get<double>(), expected.rpe_time.value->rmse, 1e-8);
}

TEST_F(EvalTrajectory, AcceptsAlignmentAndAssociationOptions) {
  const ProgramResult result = evaluate_files(
      {"--json", "--align", "yaw", "--associate", "nearest", "--max-difference", "0.002"});
  ASSERT_EQ(result.status, 0) << result.err;
  EvalOptions options;
  options.alignment = Alignment::yaw;
  options.association = {.mode = Association::nearest, .max_difference_s = 0.002, .max_gap_s = 2.0};
  const TrajectoryMetrics expected = evaluate(pair_.reference, pair_.estimate, options);
  const auto figures = json::parse(result.out).at("trajectory");
  EXPECT_EQ(figures.at("matched").get<std::size_t>(), *expected.matched);
  EXPECT_NEAR(figures.at("ate_rmse_m").get<double>(), expected.ate.value->rmse, 1e-8);
}

TEST_F(EvalTrajectory, RejectsUnknownOptionValues) {
  const ProgramResult result = evaluate_files({"--align", "sim2"});
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, HasSubstr("sim2"));
}

TEST_F(EvalTrajectory, ReportsMissingFile) {
  std::filesystem::remove(estimate_);
  expect_input_error(evaluate_files(), estimate_.string());
}

TEST_F(EvalTrajectory, ReportsTimeDistanceWithoutOverlap) {
  Trajectory other_clock = pair_.estimate;
  for (StampedPose& pose : other_clock.poses) pose.stamp = pose.stamp + Duration{100'000'000'000};
  io::write_tum(estimate_, other_clock);
  expect_input_error(evaluate_files(), "s apart)");
}

TEST_F(EvalTrajectory, ReportsNumberOfMatchesWhenTooFew) {
  expect_input_error(evaluate_files({"--associate", "nearest", "--max-difference", "1e-9"}),
                     "poses match the reference, 3 required");
}

TEST_F(EvalTrajectory, RequiresBothFiles) {
  const ProgramResult result = apvi_eval({"trajectory", "--estimate", estimate_.string()});
  EXPECT_EQ(result.status, 2);
  EXPECT_THAT(result.err, HasSubstr("--reference"));
}

// A run on a dataset with a planar reference in another world frame, as for an underwater vehicle
// with GNSS.
class EvalRun : public testing::Test {
 protected:
  EvalRun() {
    std::string gnss = "#timestamp [ns],east [m],north [m],up [m]\n";
    Trajectory ned;
    for (int i = 0; i < 200; ++i) {
      const double t = 0.1 * i;
      const Stamp stamp{5'000'000'000 + 100'000'000LL * i};
      const Eigen::Vector3d east_north(3.0 * std::sin(t), 0.5 * t * t, 0.0);
      gnss += fmt::format("{},{},{},0\n", stamp.ns, east_north.x(), east_north.y());
      ned.poses.push_back({stamp, {{1, 0, 0, 0}, {east_north.y(), east_north.x(), 2.0}}});
    }
    dir_.write("data/mav0/gnss0/data.csv", gnss);
    dir_.write("data/rig.yaml", "body: imu0\nimu0: {rate_hz: 100}\n");
    dir_.write("data/mav0/imu0/data.csv",
               "#timestamp [ns],w_x [rad s^-1],w_y [rad s^-1],w_z [rad s^-1],a_x [m s^-2],a_y [m "
               "s^-2],a_z [m s^-2]\n5000000000,0,0,0,0,0,-9.8\n5010000000,0,0,0,0,0,-9.8\n");
    write_resolved("");
    io::write_tum(run_ / "trajectory.tum", ned);
    io::write_tum(run_ / "dipo.tum", ned);
  }
  void write_resolved(const std::string& more) {
    dir_.write("run/resolved.yaml", fmt::format("dataset: {{path: {}, format: folder{}}}\n"
                                                "rig: {{world: ned}}\nother: {{key: 1}}\n",
                                                (dir_.path() / "data").string(), more));
  }

  test::TmpDir dir_;
  std::filesystem::path run_ = dir_.path() / "run";
};

TEST_F(EvalRun, LoadsReferenceOfDatasetAndConvertsWorldFrames) {
  dir_.write("run/metrics.json", R"({"speed": {"wall_s": 1.5}})");
  const ProgramResult result = apvi_eval({run_.string(), "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  const json metrics = json::parse(result.out);
  EXPECT_LT(metrics.at("trajectory").at("ate_rmse_m").get<double>(), 1e-6);
  EXPECT_LT(metrics.at("trajectory").at("dipo").at("ate_rmse_m").get<double>(), 1e-6);
  EXPECT_FALSE(metrics.at("trajectory").contains("vio"));
  EXPECT_FALSE(metrics.at("trajectory").contains("rot_rmse_deg"));
  EXPECT_EQ(metrics.at("speed").at("wall_s"), 1.5);
  EXPECT_EQ(json::parse(test::read_file(run_ / "metrics.json")), metrics);
}

TEST_F(EvalRun, EvaluatesOnlyTheProcessedSpan) {
  write_resolved(", duration_s: 10");
  Trajectory part = io::read_trajectory(run_ / "trajectory.tum");
  part.poses.resize(101);
  io::write_tum(run_ / "trajectory.tum", part);
  const ProgramResult result = apvi_eval({run_.string(), "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_NEAR(json::parse(result.out)["trajectory"]["coverage"].get<double>(), 1.0, 1e-9);
}

TEST_F(EvalRun, UsesOptionsOfRunUnlessOverridden) {
  std::ofstream(run_ / "resolved.yaml", std::ios::app) << "eval: {align: none, max_gap_s: 0.01}\n";
  const json as_configured = json::parse(apvi_eval({run_.string(), "--json"}).out)["trajectory"];
  EXPECT_EQ(as_configured.at("coverage"), 0.0);
  const json told =
      json::parse(apvi_eval({run_.string(), "--json", "--max-gap", "1"}).out)["trajectory"];
  EXPECT_EQ(told.at("coverage"), 1.0);
}

TEST_F(EvalRun, AcceptsOtherReferenceWithItsWorldFrame) {
  std::filesystem::copy(dir_.path() / "data/mav0/gnss0/data.csv", dir_.path() / "better.csv");
  const ProgramResult result =
      apvi_eval({run_.string(), "--reference", (dir_.path() / "better.csv").string(), "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_LT(json::parse(result.out)["trajectory"]["ate_rmse_m"].get<double>(), 1e-6);
}

TEST_F(EvalRun, EvaluatesEndToStartWithoutReference) {
  std::filesystem::remove_all(dir_.path() / "data/mav0/gnss0");
  const ProgramResult result = apvi_eval({run_.string(), "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  const json figures = json::parse(result.out).at("trajectory");
  EXPECT_GT(figures.at("end_to_start_m").get<double>(), 100.0);
  EXPECT_FALSE(figures.contains("ate_rmse_m"));
  EXPECT_FALSE(figures.contains("coverage"));
}

TEST_F(EvalRun, SkipsEstimatorThatNeverStarted) {
  dir_.write("run/vio.tum", "");
  const ProgramResult result = apvi_eval({run_.string(), "--json"});
  ASSERT_EQ(result.status, 0) << result.err;
  EXPECT_FALSE(json::parse(result.out).at("trajectory").contains("vio"));
  EXPECT_THAT(result.err, HasSubstr("vio.tum"));
}

TEST_F(EvalRun, ReportsMissingInputs) {
  std::filesystem::remove(run_ / "resolved.yaml");
  expect_input_error(apvi_eval({run_.string()}), "resolved.yaml");
  std::filesystem::remove(run_ / "trajectory.tum");
  expect_input_error(apvi_eval({run_.string()}), "trajectory.tum");
  expect_input_error(apvi_eval({(dir_.path() / "nowhere").string()}), "nowhere");
}

TEST_F(EvalRun, ReportsMissingDataset) {
  std::filesystem::rename(dir_.path() / "data", dir_.path() / "moved");
  expect_input_error(apvi_eval({run_.string()}), (dir_.path() / "data").string());
}

}  // namespace
}  // namespace apvi::eval
