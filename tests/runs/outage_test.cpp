// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "apvi/io/tum.hpp"
#include "eval/metrics_file.hpp"
#include "runs/run.hpp"
#include "support/dive_folder.hpp"
#include "support/sensor_outage_sequence.hpp"
#include "support/source_dir.hpp"
#include "support/test_data.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

std::string read_all(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return (std::stringstream() << in.rdbuf()).str();
}

std::size_t count_lines(const std::string& text) {
  return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

struct Blackout {
  std::string sensor;
  double from_s;
  double to_s;
  double max_ate_m = 0.03;  ///< ATE limit
};

RunResult run_with_blackout(const RunConfig& config, const Blackout& blackout,
                            const fs::path& folder) {
  test::SensorOutageSequence reader(io::open_sequence(config.dataset, config.sensors.use),
                                    blackout.sensor, blackout.from_s, blackout.to_s);
  return run(config, reader, {.folder = folder});
}

void expect_outage_reported(const fs::path& run, const std::string& sensor) {
  const std::string log = read_all(run / "log.txt");
  EXPECT_THAT(log, HasSubstr("warning: " + sensor + ": silent since"));
  EXPECT_THAT(log, HasSubstr("info: " + sensor + ": back at"));
  EXPECT_EQ(eval::read_metrics(run / "metrics.json")["counts"]["outages"][sensor].get<int>(), 1);
}

// Every line must have as many cells as the header.
void expect_complete(const fs::path& csv) {
  std::istringstream lines(read_all(csv));
  std::string line;
  std::getline(lines, line);
  const auto commas = std::count(line.begin(), line.end(), ',');
  while (std::getline(lines, line)) {
    EXPECT_EQ(std::count(line.begin(), line.end(), ','), commas) << csv << ": " << line;
  }
}

// A simulated dive of one minute with IMU, DVL and depth.
class DiveOutage : public testing::Test {
 protected:
  DiveOutage() {
    test::write_dive(tmp_, "dive", {});
    config_.dataset.path = (tmp_.path() / "dive").string();
  }
  double ate(const Blackout& blackout) {
    const RunResult result = run_with_blackout(config_, blackout, tmp_.path() / "run");
    expect_outage_reported(tmp_.path() / "run", blackout.sensor);
    poses_ = io::read_trajectory(tmp_.path() / "run" / "trajectory.tum").poses;
    return result.metrics.fused.ate.value->rmse;
  }
  double last_pose_s() const { return seconds_between(poses_.front().stamp, poses_.back().stamp); }

  test::TmpDir tmp_;
  RunConfig config_;
  std::vector<StampedPose> poses_;
};

TEST_F(DiveOutage, DriftsLittleInFiveSecondsWithoutDvl) {
  EXPECT_LT(ate({"dvl", 25.0, 30.0}), 0.5);
  EXPECT_GT(last_pose_s(), 55.0);
}

TEST_F(DiveOutage, DriftsLittleInTenSecondsWithoutDepth) {
  EXPECT_LT(ate({"depth", 25.0, 35.0}), 0.2);
  EXPECT_GT(last_pose_s(), 55.0);
}

TEST_F(DiveOutage, DriftsLittleInHalfASecondWithoutImu) {
  EXPECT_LT(ate({"imu", 25.0, 25.5}), 0.5);
  EXPECT_GT(last_pose_s(), 55.0);
}

TEST_F(DiveOutage, LogsPermanentOutageOnce) {
  run_with_blackout(config_, {"depth", 30.0, 1e9}, tmp_.path() / "run");
  const std::string log = read_all(tmp_.path() / "run" / "log.txt");
  EXPECT_THAT(log, HasSubstr("depth: silent since"));
  EXPECT_THAT(log, testing::Not(HasSubstr("depth: back")));
}

// EuRoC MH_01 with simulated DVL and pressure sensor: 22 s, images in the first 16 s.
class RealOutage : public testing::TestWithParam<Blackout> {};

TEST_P(RealOutage, DegradesIsLoggedAndRecovers) {
  APVI_NEEDS_DATA(dataset, "euroc_mh01_apvi");
  const test::TmpDir tmp;
  const RunConfig config = load_run_config(
      test::source_dir() / "configs/datasets/euroc_apvi.yaml",
      {"dataset.path=" + dataset.string(), "dataset.duration_s=15", "run.mode=replay"});
  const RunResult result = run_with_blackout(config, GetParam(), tmp.path() / "run");
  expect_outage_reported(tmp.path() / "run", GetParam().sensor);
  EXPECT_LT(result.metrics.fused.ate.value->rmse, GetParam().max_ate_m);
  // VIO has recovered in the last second.
  const std::string health = read_all(tmp.path() / "run" / "health.csv");
  EXPECT_THAT(health.substr(health.size() - 500), HasSubstr("fused,accepted"));
  EXPECT_EQ(count_lines(health), count_lines(read_all(tmp.path() / "run" / "timing.csv")));
  expect_complete(tmp.path() / "run" / "health.csv");
  expect_complete(tmp.path() / "run" / "timing.csv");
}

INSTANTIATE_TEST_SUITE_P(Each, RealOutage,
                         testing::Values(Blackout{"camera", 6.0, 9.0}, Blackout{"dvl", 6.0, 10.0},
                                         Blackout{"pressure", 6.0, 10.0},
                                         Blackout{"imu", 6.0, 6.5, 0.015},
                                         Blackout{"imu", 8.0, 9.0, 0.02}),
                         [](const auto& one) {
                           return fmt::format("{}_{:.0f}s", one.param.sensor, one.param.from_s);
                         });

}  // namespace
}  // namespace apvi::runs
