// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "apvi/io/tum.hpp"
#include "runs/run.hpp"
#include "support/source_dir.hpp"
#include "support/test_data.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;
using test::TmpDir;

constexpr std::size_t kFrames = 320;
// The recording continues without images for 2.9 s.
constexpr std::size_t kAfterwards = 25;
// Before the first image, which is 3 s late, from 2 s on.
constexpr std::size_t kBefore = 9;

// EuRoC MH_01 with 16 seconds of images, moving from the first frame on, with DVL and pressure
// sensor simulated from its ground truth.
class RealImages : public testing::Test {
 protected:
  void SetUp() override {
    const auto folder = test::real_data("euroc_mh01_apvi");
    if (!folder) GTEST_SKIP() << "no real recordings: set APVI_TEST_DATA";
    data_ = *folder;
  }

  RunResult run_with(const std::string& name, std::vector<std::string> overrides) {
    overrides.push_back("dataset.path=" + data_.string());
    const RunConfig config =
        load_run_config(test::source_dir() / "configs/datasets/euroc_apvi.yaml", overrides);
    return run(config, {.folder = tmp_.path() / name});
  }
  std::string text(const std::string& name) const {
    std::ifstream file(tmp_.path() / name);
    return (std::stringstream() << file.rdbuf()).str();
  }

  fs::path data_;
  TmpDir tmp_;
};

TEST_F(RealImages, CameraAndImuAteIsBelow1cm) {
  const RunResult result = run_with("run", {"sensors.use=[camera, imu]"});
  EXPECT_LT(result.metrics.fused.ate.value->rmse, 0.010);
  EXPECT_FALSE(result.metrics.dipo);
  EXPECT_GT(result.poses, 290U);
}

TEST_F(RealImages, EveryFrameHasPoseWithDvlAndPressureInGraph) {
  const RunResult result = run_with("run", {});
  EXPECT_EQ(result.poses, kBefore + kFrames + kAfterwards);
  EXPECT_LT(result.metrics.fused.ate.value->rmse, 0.008);
  for (const char* name : {"vio.tum", "keyframes.tum", "dipo.tum", "health.csv", "timing.csv"}) {
    EXPECT_GT(fs::file_size(tmp_.path() / "run" / name), 1000U) << name;
  }
}

TEST_F(RealImages, AteIsBelow2cmWithEightSecondsOfBlackImages) {
  const RunResult result = run_with("run", {"dataset.blackout_s=[[6, 14]]"});
  EXPECT_EQ(result.poses, kBefore + kFrames + kAfterwards);
  EXPECT_LT(result.metrics.fused.ate.value->rmse, 0.02);
}

// The second run begins elsewhere, so that its odometry has another origin and heading.
TEST_F(RealImages, IsFoundInTheMapOfAnEarlierRun) {
  run_with("first", {});
  const std::string map = (tmp_.path() / "first").string();
  run_with("second", {"dataset.start_s=6", "smoothing.known_map=" + map});
  const auto metrics = nlohmann::json::parse(text("second/metrics.json"));
  ASSERT_TRUE(metrics["relocalization"]["found"].get<bool>());
  EXPECT_LT(metrics["relocalization"]["found_after_s"].get<double>(), 5.0);
  const Trajectory first = io::read_trajectory(tmp_.path() / "first/trajectory_smoothed.tum");
  const Trajectory second = io::read_trajectory(tmp_.path() / "second/trajectory_smoothed.tum");
  std::size_t common = 0;
  for (const StampedPose& pose : second.poses) {
    for (const StampedPose& known : first.poses) {
      if (known.stamp != pose.stamp) continue;
      ++common;
      const Eigen::Vector3d error = pose.T_world_body.translation - known.T_world_body.translation;
      EXPECT_LT(error.norm(), 0.05);
    }
  }
  EXPECT_GT(common, 100U);
  EXPECT_GT(fs::file_size(tmp_.path() / "second/places.bin"), 1000U);
}

TEST_F(RealImages, ReplayOnThreadsIsBitIdenticalToSequential) {
  run_with("one", {"dataset.duration_s=10"});
  run_with("three", {"dataset.duration_s=10", "run.mode=replay"});
  for (const char* name : {"trajectory.tum", "trajectory_smoothed.tum", "vio.tum", "keyframes.tum",
                           "dipo.tum", "health.csv"}) {
    EXPECT_EQ(text(std::string("one/") + name), text(std::string("three/") + name)) << name;
  }
}

TEST_F(RealImages, AStopKeepsResults) {
  const RunConfig config = load_run_config(test::source_dir() / "configs/datasets/euroc_apvi.yaml",
                                           {"dataset.path=" + data_.string(), "run.mode=replay"});
  int asked = 0;
  const RunResult result =
      run(config, {.folder = tmp_.path() / "run", .interrupted = [&] { return ++asked > 3000; }});
  EXPECT_TRUE(result.interrupted);
  EXPECT_GT(result.poses, 20U);
  EXPECT_TRUE(fs::exists(tmp_.path() / "run" / "metrics.json"));
  EXPECT_EQ(io::read_trajectory(tmp_.path() / "run" / "trajectory_smoothed.tum").size(),
            result.poses);
}

TEST_F(RealImages, SmoothedTrajectoryIsNoWorseAndCanBeTurnedOff) {
  const RunResult result = run_with("run", {});
  ASSERT_TRUE(result.metrics.smoothed);
  EXPECT_LT(result.metrics.smoothed->ate.value->rmse, 1.05 * result.metrics.fused.ate.value->rmse);
  EXPECT_EQ(result.metrics.smoothed->matched, result.metrics.fused.matched);
  EXPECT_FALSE(run_with("off", {"smoothing.enabled=false"}).metrics.smoothed);
  EXPECT_FALSE(fs::exists(tmp_.path() / "off" / "trajectory_smoothed.tum"));
  EXPECT_EQ(text("run/trajectory.tum"), text("off/trajectory.tum"));
}

// A reef filmed with an action camera, too evenly for a scale by its IMU.
class Reef : public testing::Test {
 protected:
  void SetUp() override {
    const auto folder = test::real_data("reef_gopro");
    if (!folder) GTEST_SKIP() << "no real recordings: set APVI_TEST_DATA";
    data_ = *folder;
  }

  RunResult run_with(const std::string& sensors) {
    const RunConfig config =
        load_run_config(test::source_dir() / "configs/localization.yaml",
                        {"dataset.path=" + data_.string(), "sensors.use=" + sensors});
    return run(config, {.folder = tmp_.path() / "run"});
  }
  nlohmann::json scale() const {
    std::ifstream file(tmp_.path() / "run" / "metrics.json");
    return nlohmann::json::parse(file)["scale"];
  }

  fs::path data_;
  TmpDir tmp_;
};

constexpr std::size_t kReefFrames = 211;

TEST_F(Reef, CameraAloneFindsTheShapeOfThePath) {
  const RunResult result = run_with("[camera]");
  EXPECT_GE(result.poses, kReefFrames * 95 / 100);
  EXPECT_LT(*result.metrics.fused.ate_percent_of_path, 2.0);
  EXPECT_FALSE(scale()["known"]);
  EXPECT_EQ(scale()["vertical"], "assumed");
}

TEST_F(Reef, CameraAndImuFindTheShapeOfThePathAndTheVertical) {
  const RunResult result = run_with("[camera, imu]");
  EXPECT_GE(result.poses, kReefFrames * 95 / 100);
  EXPECT_LT(*result.metrics.fused.ate_percent_of_path, 2.0);
  EXPECT_EQ(scale()["vertical"], "accelerometer");
}

}  // namespace
}  // namespace apvi::runs
