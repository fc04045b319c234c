// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/online_run.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "eval/metrics_file.hpp"
#include "map_io/ply.hpp"
#include "runs/run_observer.hpp"
#include "runs/survey/export.hpp"
#include "runs/views/render_run.hpp"
#include "sim/simulate.hpp"
#include "slam/async_mapper.hpp"
#include "support/out_of_memory.hpp"
#include "support/source_dir.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

// Calls of MappingRunOptions::interrupted after which the map has hundreds of Gaussians.
constexpr int kAskedWithMap = 1400;

/// Simulates a dive over a reef with a low-resolution camera.
void simulate_reef(const fs::path& to, std::vector<std::string> overrides) {
  overrides.insert(overrides.end(), {"rig.cam0.resolution=[240, 180]",
                                     "rig.cam0.intrinsics=[157.5, 157.5, 119.5, 89.5]"});
  sim::simulate(sim::load_scene(test::source_dir() / "configs/scenes/seabed_easy.yaml", overrides),
                to, {.threads = 2});
}

OnlineRunResult run_recording(const RunConfig& config, const MappingRunOptions& options) {
  const auto recording = io::open_sequence(config.dataset, config.sensors.use);
  return run_online(config, *recording, options);
}

/// A simulated dive of seven seconds, created once for all tests.
class OnlineRunTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    data_ = std::make_unique<test::TmpDir>();
    simulate_reef(data_->path() / "reef", {"duration_s=7", "rig.cam0.rate_hz=15"});
  }
  static void TearDownTestSuite() { data_.reset(); }

  static RunConfig config(std::vector<std::string> overrides = {}) {
    overrides.insert(
        overrides.begin(),
        {"dataset.path=" + (data_->path() / "reef").string(), "mapping.enabled=true",
         "mapping.densification=quadtree", "mapping.medium=true", "mapping.sh_degree=0",
         "mapping.initial_downscale=2", "mapping.max_gaussians=6000", "mapping.final_iterations=60",
         "vio.tracker.min_distance_px=14",  // few pixels
         "mapping.online.steps_per_keyframe=8"});
    return load_run_config(test::source_dir() / "configs/default.yaml", overrides);
  }
  fs::path folder(const std::string& name) const { return tmp_.path() / name; }
  static std::string bytes(const fs::path& file) {
    std::ifstream in(file, std::ios::binary);
    return (std::stringstream() << in.rdbuf()).str();
  }

  static std::unique_ptr<test::TmpDir> data_;
  test::TmpDir tmp_;
};

std::unique_ptr<test::TmpDir> OnlineRunTest::data_;

TEST_F(OnlineRunTest, WritesLocalizationAndMapIntoOneFolder) {
  const OnlineRunResult result = run_recording(config(), {.folder = folder("run")});
  ASSERT_TRUE(result.localization);
  EXPECT_LT(result.localization->metrics.fused.ate.value->rmse, 0.03);
  const eval::Json metrics = eval::read_metrics(folder("run") / "metrics.json");
  const eval::Json& map = metrics["mapping"];
  EXPECT_GT(map["psnr_db"].get<double>(), map["psnr_median_image_db"].get<double>() + 2.0);
  EXPECT_GT(map["heldout_views"].get<int>(), 3);
  EXPECT_LT(map["depth_abs_rel"].get<double>(), 0.1);
  EXPECT_GT(map["restored_psnr_db"].get<double>(), 12.0);
  EXPECT_GT(map["off_path_views"].get<int>(), 3);
  EXPECT_GT(map["off_path_psnr_db"].get<double>(), 12.0);
  EXPECT_LT(map["off_path_psnr_db"].get<double>(), map["psnr_db"].get<double>());
  // Every eighth of 106 images; the first ones have no pose yet.
  EXPECT_EQ(map["all_images"]["images"], 14);
  EXPECT_LE(map["all_images"]["without_pose"].get<int>(), 2);
  EXPECT_NEAR(map["all_images"]["psnr_db"].get<double>(), map["psnr_db"].get<double>(), 2.0);
  EXPECT_LE(map["gaussians"].get<int>(), 6000);
  EXPECT_TRUE(metrics["medium"].contains("error_percent"));
  EXPECT_TRUE(metrics["trajectory"].contains("ate_rmse_m"));
  EXPECT_EQ(metrics["dropped"]["keyframes"], 0);
  for (const char* file :
       {"map.ply", "medium.json", "keyframes.tum", "trajectory.tum", "checkpoint.pt",
        "resolved.yaml", "mapping.csv", "sensors.csv", "loops.csv"}) {
    EXPECT_TRUE(fs::exists(folder("run") / file)) << file;
  }
  // The map can be rendered, exported and refined further.
  const fs::path images = folder("images");
  EXPECT_GT(render_run({.source = folder("run"), .out = images, .restore = true}), 5U);
  EXPECT_GE(load_finished_run(folder("run")).keyframes.size(),
            io::read_trajectory(folder("run") / "keyframes.tum").size());
  const OnlineRunResult more = run_recording(config({"mapping.final_iterations=10"}),
                                             {.folder = folder("run"), .resume = true});
  EXPECT_FALSE(more.localization);
  EXPECT_EQ(more.map.iterations, result.map.iterations + 10);
}

/// Asks for the map to be saved once, when there is one.
class SavingObserver : public RunObserver {
 public:
  explicit SavingObserver(fs::path folder) : folder_(std::move(folder)) {}

  void begin(const Rig&) override {}
  void sample(const SensorEvent&) override { ++samples; }
  void ping(const localization::PingOutput&) override {}
  void frame(const localization::FrameOutput&) override {}
  void image(const localization::MapFrame&) override {
    if (mapper_->gaussian_count() > 0 && !std::exchange(asked_, true)) save_();
  }
  void map_begins(slam::AsyncMapper& mapper, std::function<void()> save) override {
    mapper_ = &mapper;
    save_ = std::move(save);
  }
  void map_ends() override {}
  void map_saved(const std::string& error) override {
    answers.push_back(error);
    saved = map_io::read_ply(folder_ / "map.ply").size();
    has_checkpoint = fs::exists(folder_ / "checkpoint.pt");
    was_over = fs::exists(folder_ / "metrics.json");
  }

  int samples = 0;
  std::vector<std::string> answers;
  std::int64_t saved = 0;
  bool has_checkpoint = false;
  bool was_over = true;

 private:
  fs::path folder_;
  slam::AsyncMapper* mapper_ = nullptr;
  std::function<void()> save_;
  bool asked_ = false;
};

TEST_F(OnlineRunTest, SavesTheMapOnRequestAndGoesOn) {
  const RunConfig plain = config({"mapping.final_iterations=5", "dataset.duration_s=4"});
  run_recording(plain, {.folder = folder("plain")});
  SavingObserver observer(folder("asked"));
  const auto result = run_recording(plain, {.folder = folder("asked"), .observer = &observer});
  EXPECT_EQ(observer.answers, std::vector<std::string>{""});
  EXPECT_GT(observer.saved, 0);
  EXPECT_TRUE(observer.has_checkpoint);
  EXPECT_FALSE(observer.was_over);
  EXPECT_GT(observer.samples, 800);
  EXPECT_FALSE(result.map.interrupted);
  EXPECT_EQ(bytes(folder("asked") / "map.ply"), bytes(folder("plain") / "map.ply"));
}

TEST_F(OnlineRunTest, ReplayOnThreadsGivesSameMap) {
  const std::vector<std::string> less = {"mapping.final_iterations=5"};
  run_recording(config(less), {.folder = folder("one")});
  std::vector<std::string> replay = less;
  replay.emplace_back("run.mode=replay");
  run_recording(config(replay), {.folder = folder("three")});
  for (const char* file : {"map.ply", "keyframes.tum", "trajectory.tum"}) {
    EXPECT_EQ(bytes(folder("one") / file), bytes(folder("three") / file)) << file;
  }
}

TEST_F(OnlineRunTest, KeyframesOfTheMapLieOnTheSmoothedTrajectory) {
  const fs::path round = folder("round");
  simulate_reef(round,
                {"duration_s=17", "rig.cam0.rate_hz=10", "motion.path=orbit",
                 "motion.origin=[0, 0, -7]", "motion.radius_m=0.8", "motion.max_turn_deg_s=60"});
  const std::vector<std::string> overrides = {"dataset.path=" + round.string(),
                                              "smoothing.min_age_s=10",
                                              "mapping.medium=false",
                                              "vio.calibration.camera_mounting.estimate=false",
                                              "vio.calibration.camera_lever_arm.estimate=false",
                                              "mapping.final_iterations=0",
                                              "mapping.online.steps_per_keyframe=1"};
  run_recording(config(overrides), {.folder = folder("run")});
  const eval::Json metrics = eval::read_metrics(folder("run") / "metrics.json");
  EXPECT_GT(metrics["mapping"]["closed_loops"].get<int>(), 0);
  const Trajectory smoothed = io::read_trajectory(folder("run") / "trajectory_smoothed.tum");
  const Trajectory keyframes = io::read_trajectory(folder("run") / "keyframes.tum");
  EXPECT_GT(keyframes.size(), 10U);
  for (const StampedPose& keyframe : keyframes.poses) {
    const auto pose = smoothed.at(keyframe.stamp, Duration::from_seconds(0.2));
    ASSERT_TRUE(pose);
    EXPECT_LT((pose->translation - keyframe.T_world_body.translation).norm(), 0.005);
  }
}

TEST_F(OnlineRunTest, InterruptSavesMap) {
  int asked = 0;
  MappingRunOptions options{.folder = folder("run")};
  options.interrupted = [&asked] { return ++asked > kAskedWithMap; };
  const OnlineRunResult result = run_recording(config(), options);
  EXPECT_TRUE(result.map.interrupted);
  EXPECT_TRUE(result.localization->interrupted);
  EXPECT_GT(map_io::read_ply(folder("run") / "map.ply").size(), 100);
  EXPECT_TRUE(fs::exists(folder("run") / "checkpoint.pt"));
}

// The folder is copied during the run, as a power cut would leave it, with a checkpoint of a map
// that has grown.
TEST_F(OnlineRunTest, ACheckpointDuringTheRunCanBeResumed) {
  MappingRunOptions options{.folder = folder("run")};
  int asked = 0;
  options.interrupted = [this, &asked] {
    const fs::path checkpoint = folder("run") / "checkpoint.pt";
    if (++asked == kAskedWithMap) fs::remove(checkpoint);
    if (asked <= kAskedWithMap || !fs::exists(checkpoint) || fs::exists(folder("cut")))
      return false;
    fs::copy(folder("run"), folder("cut"), fs::copy_options::recursive);
    return true;
  };
  run_recording(config({"mapping.checkpoint_every_s=0.05"}), options);
  ASSERT_TRUE(fs::exists(folder("cut")));
  const OnlineRunResult more = run_recording(config({"mapping.final_iterations=10"}),
                                             {.folder = folder("cut"), .resume = true});
  EXPECT_FALSE(more.map.interrupted);
  EXPECT_GT(more.map.gaussians, 100);
}

/// An `interrupted` callback, polled before each of a keyframe's eight steps and once after them,
/// that makes the allocator fail in the middle of the steps of a later keyframe. It recognizes
/// mapping by allocations between consecutive polls, which localization hardly ever has.
std::function<bool()> ends_in_a_step(test::OutOfMemoryAllocator& memory, int refused) {
  return [&memory, refused, asked = 0, in_a_row = 0]() mutable {
    const bool worked = memory.request_count() != std::exchange(asked, memory.request_count());
    in_a_row = worked ? in_a_row + 1 : 0;
    if (in_a_row == 9 * 16 + 5) memory.fail_after(0, refused);
    return false;
  };
}

TEST_F(OnlineRunTest, OutOfMemoryKeepsMapAndTrajectory) {
  APVI_SKIP_ON_GPU();
  const auto whole =
      run_recording(config({"mapping.final_iterations=0"}), {.folder = folder("whole")});
  try {
    test::OutOfMemoryAllocator memory;  // fails again while the map is reduced
    run_recording(config(), {.folder = folder("run"), .interrupted = ends_in_a_step(memory, 2)});
    FAIL() << "no exception";
  } catch (const RunError& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("mapping.max_gaussians (now 6000)"), std::string::npos) << message;
  }
  EXPECT_GT(map_io::read_ply(folder("run") / "map.ply").size(), 500);
  EXPECT_EQ(io::read_trajectory(folder("run") / "trajectory.tum").size(),
            whole.localization->poses);
  EXPECT_TRUE(eval::read_metrics(folder("run") / "metrics.json").contains("trajectory"));
  const Trajectory keyframes = io::read_trajectory(folder("run") / "keyframes.tum");
  const Trajectory poses = io::read_trajectory(folder("run") / "trajectory.tum");
  EXPECT_LT(seconds_between(keyframes.poses.back().stamp, poses.poses.back().stamp), 1.0);
  const OnlineRunResult more = run_recording(config({"mapping.max_gaussians=500"}),
                                             {.folder = folder("run"), .resume = true});
  EXPECT_FALSE(more.map.interrupted);
  EXPECT_EQ(more.map.gaussians, 500);
}

TEST_F(OnlineRunTest, MetricsReportReducedGaussianLimit) {
  APVI_SKIP_ON_GPU();
  {
    test::OutOfMemoryAllocator memory;
    run_recording(config(), {.folder = folder("run"), .interrupted = ends_in_a_step(memory, 1)});
  }
  const eval::Json map = eval::read_metrics(folder("run") / "metrics.json")["mapping"];
  EXPECT_LT(map["reduced_max_gaussians"].get<int>(), 6000);
  EXPECT_LE(map["gaussians"].get<int>(), map["reduced_max_gaussians"].get<int>());
  EXPECT_GT(map["psnr_db"].get<double>(), map["psnr_median_image_db"].get<double>() + 2.0);
}

TEST_F(OnlineRunTest, TrajectoryIsCompleteWhenMapCannotBeWritten) {
  const auto whole =
      run_recording(config({"mapping.final_iterations=0"}), {.folder = folder("whole")});
  for (const std::string mode : {"sequential", "replay"}) {
    SCOPED_TRACE(mode);
    MappingRunOptions options{.folder = folder(mode)};
    options.interrupted = [this, mode] {  // a folder where map.ply is to be written
      fs::create_directories(folder(mode) / "map.ply" / "x");
      return false;
    };
    EXPECT_THROW(
        run_recording(config({"run.mode=" + mode, "mapping.checkpoint_every_s=0.01"}), options),
        RunError);
    EXPECT_EQ(io::read_trajectory(folder(mode) / "trajectory.tum").size(),
              whole.localization->poses);
    EXPECT_TRUE(eval::read_metrics(folder(mode) / "metrics.json").contains("trajectory"));
  }
}

TEST_F(OnlineRunTest, RejectsImpossibleRunsImmediately) {
  EXPECT_THROW(config({"sensors.use=[imu, dvl]"}), InputError);
  EXPECT_THROW(config({"mapping.depth.min_depth_m=30"}), InputError);
  EXPECT_THROW(config({"mapping.depth.quadtree.max_block_px=12"}), InputError);
  EXPECT_THROW(run_recording(config(), {.folder = folder("none"), .resume = true}), InputError);
  fs::create_directories(folder("taken"));
  std::ofstream(folder("taken") / "map.ply") << "x";
  EXPECT_THROW(run_recording(config(), {.folder = folder("taken")}), InputError);
  EXPECT_EQ(bytes(folder("taken") / "map.ply"), "x");
}

TEST_F(OnlineRunTest, WritesTrajectoryWithoutAcceptedKeyframes) {
  EXPECT_THROW(run_recording(config({"dataset.blackout_s=[[0, 100]]"}), {.folder = folder("run")}),
               RunError);
  EXPECT_GT(fs::file_size(folder("run") / "trajectory.tum"), 100U);
  EXPECT_FALSE(fs::exists(folder("run") / "map.ply"));
}

}  // namespace
}  // namespace apvi::runs
