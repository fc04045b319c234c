// SPDX-License-Identifier: BSD-3-Clause
#include "runs/run.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "apvi/core/error.hpp"
#include "apvi/io/tum.hpp"
#include "eval/metrics_file.hpp"
#include "loop_closure/place_map.hpp"
#include "support/dive_folder.hpp"
#include "support/source_dir.hpp"
#include "support/test_data.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

namespace fs = std::filesystem;

RunConfig config_for(const fs::path& dataset) {
  RunConfig config;
  config.dataset.path = dataset.string();
  return config;
}

std::string read_all(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

TEST(Run, WritesTrajectoryMetricsAndResolvedConfiguration) {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {});
  const RunResult result = run(config_for(tmp.path() / "dive"), {.folder = tmp.path() / "run"});
  EXPECT_GT(result.poses, 250U);
  EXPECT_LT(result.metrics.fused.ate.value->rmse, 0.2);
  const Trajectory trajectory = io::read_trajectory(tmp.path() / "run" / "trajectory.tum");
  EXPECT_EQ(trajectory.size(), result.poses);
  const auto metrics = eval::read_metrics(tmp.path() / "run" / "metrics.json");
  EXPECT_NEAR(metrics["trajectory"]["ate_rmse_m"].get<double>(),
              result.metrics.fused.ate.value->rmse, 1e-9);
  EXPECT_GT(metrics["counts"]["dvl"]["accepted"].get<int>(), 250);
  for (const char* name : {"dipo.tum", "calibration.csv", "pings.csv", "log.txt"}) {
    EXPECT_GT(fs::file_size(tmp.path() / "run" / name), 0U) << name;
  }
}

TEST(Run, ResolvedConfigurationReproducesRunExactly) {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {});
  RunConfig config = config_for(tmp.path() / "dive");
  config.dipo.dvl.time_offset.sigma = 0.2;
  config::apply_override(config.rig, "dvl0.sound_speed=1480");
  run(config, {.folder = tmp.path() / "first"});
  const RunConfig again = load_run_config(tmp.path() / "first" / "resolved.yaml", {});
  run(again, {.folder = tmp.path() / "second"});
  EXPECT_EQ(read_all(tmp.path() / "first" / "trajectory.tum"),
            read_all(tmp.path() / "second" / "trajectory.tum"));
  EXPECT_EQ(read_all(tmp.path() / "first" / "calibration.csv"),
            read_all(tmp.path() / "second" / "calibration.csv"));
}

TEST(Run, RealtimeFollowsPlaybackRateWithIdenticalPoses) {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {});
  RunConfig config = config_for(tmp.path() / "dive");
  run(config, {.folder = tmp.path() / "sequential"});
  config.run.mode = localization::RunMode::realtime;
  config.run.playback_rate = 50.0;
  const RunResult result = run(config, {.folder = tmp.path() / "paced"});
  EXPECT_GE(result.wall_s, result.sequence_s / config.run.playback_rate);
  EXPECT_LT(result.wall_s, 0.5 * result.sequence_s);
  EXPECT_EQ(read_all(tmp.path() / "sequential" / "trajectory.tum"),
            read_all(tmp.path() / "paced" / "trajectory.tum"));
}

TEST(Run, AnInterruptKeepsResults) {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {});
  int samples = 0;
  const RunResult result =
      run(config_for(tmp.path() / "dive"),
          {.folder = tmp.path() / "run", .overwrite = false, .interrupted = [&samples] {
             return ++samples > 4000;
           }});
  EXPECT_TRUE(result.interrupted);
  EXPECT_GT(result.poses, 50U);
  EXPECT_EQ(io::read_trajectory(tmp.path() / "run" / "trajectory.tum").size(), result.poses);
  EXPECT_TRUE(fs::exists(tmp.path() / "run" / "metrics.json"));
}

TEST(Run, KeepsResultsWhenTheReferenceCannotBeRead) {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {});
  tmp.write("dive/mav0/state_groundtruth_estimate0/data.csv", "nothing of use\n");
  const RunResult result = run(config_for(tmp.path() / "dive"), {.folder = tmp.path() / "run"});
  EXPECT_GT(result.poses, 250U);
  EXPECT_FALSE(result.metrics.fused.ate.value);
  const auto metrics = eval::read_metrics(tmp.path() / "run" / "metrics.json");
  EXPECT_GT(metrics["counts"]["dvl"]["accepted"].get<int>(), 250);
  EXPECT_THAT(read_all(tmp.path() / "run" / "log.txt"),
              testing::HasSubstr("no evaluation against the reference"));
}

TEST(Run, RefusesToOverwriteRun) {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {});
  const RunConfig config = config_for(tmp.path() / "dive");
  run(config, {.folder = tmp.path() / "run"});
  EXPECT_THROW(run(config, {.folder = tmp.path() / "run"}), InputError);
  EXPECT_NO_THROW(run(config, {.folder = tmp.path() / "run", .overwrite = true}));
}

TEST(Run, RefusesAKnownMapThatCannotBeUsedBeforeItWritesAnything) {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {});
  RunConfig config = config_for(tmp.path() / "dive");
  const auto refuses = [&](const std::string& map, const std::string& text) {
    config.smoothing.known_map = (tmp.path() / map).string();
    EXPECT_THAT([&] { run(config, {.folder = tmp.path() / "run"}); },
                testing::ThrowsMessage<InputError>(testing::HasSubstr(text)));
    EXPECT_FALSE(fs::exists(tmp.path() / "run"));
  };
  refuses("none", "no such run folder");
  refuses("dive", "no places.bin");
  loop_closure::PlaceMap map;
  map.places.emplace_back();
  fs::create_directory(tmp.path() / "map");
  save(map, tmp.path() / "map" / loop_closure::kPlacesFile);
  refuses("map", "needs a camera");
}

TEST(Run, ReportsFullDisk) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "needs /dev/full";
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {});
  fs::create_directories(tmp.path() / "run");
  fs::create_symlink("/dev/full", tmp.path() / "run" / "calibration.csv");
  try {
    run(config_for(tmp.path() / "dive"), {.folder = tmp.path() / "run"});
    FAIL() << "no exception";
  } catch (const RunError& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("disk full"));
  }
}

TEST(Run, FailsWithoutBottomLockAndNamesTheMissingInput) {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {.dvl_valid = false});
  try {
    run(config_for(tmp.path() / "dive"), {.folder = tmp.path() / "run"});
    FAIL() << "no exception";
  } catch (const RunError& e) {
    EXPECT_THAT(e.what(), testing::HasSubstr("a DVL ping with bottom lock"));
  }
}

TEST(Run, InvalidSamplesDoNotProduceInvalidPoses) {
  const test::TmpDir tmp;
  test::write_dive(tmp, "dive", {.broken_samples = true});
  const RunResult result = run(config_for(tmp.path() / "dive"), {.folder = tmp.path() / "run"});
  EXPECT_LT(result.metrics.fused.ate.value->rmse, 0.5);
  for (const StampedPose& pose : io::read_trajectory(tmp.path() / "run" / "trajectory.tum").poses) {
    EXPECT_TRUE(pose.T_world_body.translation.allFinite());
  }
  const auto metrics = eval::read_metrics(tmp.path() / "run" / "metrics.json");
  EXPECT_GE(metrics["counts"]["dropped_samples"]["imu"].get<int>(), 3);
}

TEST(RunConfig, RejectsUnknownOrInsufficientSensors) {
  const test::TmpDir tmp;
  const fs::path file = tmp.write("a.yaml", "run: {seed: 1}\n");
  EXPECT_THROW(load_run_config(file, {"sensors.use=[imu, sonar]"}), InputError);
  EXPECT_THROW(load_run_config(file, {"sensors.use=[imu, pressure]"}), InputError);
  EXPECT_NO_THROW(load_run_config(file, {"sensors.use=[camera, imu]"}));
  EXPECT_NO_THROW(load_run_config(file, {"sensors.use=[imu, dvl]"}));
}

double ate_of(const fs::path& config_file, const fs::path& dataset, const fs::path& folder,
              std::vector<std::string> overrides = {}) {
  overrides.push_back("dataset.path=" + dataset.string());
  return run(load_run_config(config_file, overrides), {.folder = folder, .overwrite = true})
      .metrics.fused.ate.value->rmse;
}

const fs::path kConfigs = test::source_dir() / "configs";

TEST(RealDives, AkitMeanAteIsBelow30cm) {
  const test::TmpDir tmp;
  double sum = 0.0;
  for (int i = 1; i <= 6; ++i) {
    APVI_NEEDS_DATA(dataset, "akit_0" + std::to_string(i));
    const double ate = ate_of(kConfigs / "datasets" / "akit.yaml", dataset, tmp.path() / "run");
    EXPECT_LT(ate, 0.75) << dataset;
    sum += ate / 6.0;
  }
  EXPECT_LT(sum, 0.30);
}

TEST(RealDives, BlueyeImprovesWithKnownSoundSpeed) {
  APVI_NEEDS_DATA(dataset, "blueye_auto_square");
  const test::TmpDir tmp;
  const fs::path config = kConfigs / "datasets" / "blueye.yaml";
  EXPECT_LT(ate_of(config, dataset, tmp.path() / "run"), 1.35);
  EXPECT_LT(ate_of(config, dataset, tmp.path() / "run", {"rig.dvl0.sound_speed=1425"}), 0.95);
}

TEST(RealDives, EurocEstimatesDvlDelayWithAteBelow2cm) {
  APVI_NEEDS_DATA(dataset, "euroc_mh01_apvi");
  const test::TmpDir tmp;
  const fs::path folder = tmp.path() / "run";
  EXPECT_LT(ate_of(kConfigs / "datasets" / "euroc_apvi.yaml", dataset, folder), 0.02);
  std::istringstream lines(read_all(folder / "calibration.csv"));
  std::string last;
  for (std::string line; std::getline(lines, line);) last = line;
  EXPECT_NEAR(std::stod(last.substr(last.find(',') + 1)), 0.10, 0.02);
}

}  // namespace
}  // namespace apvi::runs
