// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/slam/system.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "apvi/core/error.hpp"
#include "apvi/io/sequence.hpp"
#include "apvi/io/tum.hpp"
#include "sim/simulate.hpp"
#include "support/source_dir.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::slam {
namespace {

/// A simulated dive of six seconds with a small camera, created once for all tests.
class SlamSystem : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    data_ = std::make_unique<test::TmpDir>();
    const std::vector<std::string> overrides = {"duration_s=6", "rig.cam0.rate_hz=10",
                                                "rig.cam0.resolution=[200, 150]",
                                                "rig.cam0.intrinsics=[131, 131, 99.5, 74.5]"};
    sim::simulate(
        sim::load_scene(test::source_dir() / "configs/scenes/seabed_easy.yaml", overrides),
        data_->path() / "reef", {.threads = 2});
    io::DatasetConfig dataset;
    dataset.path = (data_->path() / "reef").string();
    const auto recording = io::open_sequence(dataset, localization::SensorOptions{}.use);
    rig_ = make_rig(recording->rig());
    while (auto sample = recording->next()) samples_.push_back(std::move(*sample));
  }
  static void TearDownTestSuite() {
    samples_.clear();
    data_.reset();
  }

  static Options options(localization::RunMode mode = localization::RunMode::sequential) {
    Options out;
    out.localization.run.mode = mode;
    out.localization.vio.tracker.min_distance_px = 14.0;  // few pixels
    out.mapping.enabled = MapSwitch::on;
    out.mapping.medium = true;
    out.mapping.trainer.densify.kind = mapping::Densification::quadtree;
    out.mapping.trainer.densify.max_gaussians = 3000;
    out.mapping.trainer.sh_degree = 0;
    out.mapping.trainer.initial_downscale = 2;
    out.mapping.trainer.final_iterations = 5;
    out.mapping.online.steps_per_keyframe = 4;
    return out;
  }
  static void process_all(System& system) {
    for (const SensorEvent& sample : samples_) system.process(sample);
    system.finish();
  }
  static RenderView view_from(const SE3& T_world_body) {
    CameraModel::Parameters camera = rig_.cameras.front().model.parameters();
    camera.distortion = Distortion::none;
    return {camera, T_world_body * rig_.cameras.front().T_body_camera};
  }

  static std::unique_ptr<test::TmpDir> data_;
  static Rig rig_;
  static std::vector<SensorEvent> samples_;
};

std::unique_ptr<test::TmpDir> SlamSystem::data_;
Rig SlamSystem::rig_;
std::vector<SensorEvent> SlamSystem::samples_;

std::string tum(const Trajectory& trajectory) {
  std::string lines;
  for (const StampedPose& pose : trajectory.poses) lines += io::tum_line(pose);
  return lines;
}

TEST_F(SlamSystem, GivesPosesMapAndRendersWithoutFiles) {
  std::size_t poses = 0;
  System system(options(), rig_, {.pose = [&](const StampedPose&) { ++poses; }});
  EXPECT_FALSE(system.map());
  EXPECT_FALSE(system.pose());
  process_all(system);
  system.refine();

  EXPECT_EQ(system.trajectory().size(), poses);
  EXPECT_GT(poses, 40U);
  const auto map = system.map();
  ASSERT_TRUE(map);
  EXPECT_GT(map->count, 500U);
  EXPECT_EQ(map->means.size(), 3 * map->count);
  EXPECT_EQ(map->spherical_harmonics.size(), 3 * map->sh_coefficients * map->count);
  EXPECT_GT(system.status().keyframes, 4U);
  EXPECT_GT(map->keyframes.size(), system.status().keyframes);  // held-out views too
  ASSERT_TRUE(map->medium);
  for (const double beta : map->medium->beta_d) EXPECT_GT(beta, 0.0);

  const auto images = system.render(view_from(system.pose()->T_world_body));
  ASSERT_TRUE(images);
  EXPECT_EQ(images->color.size(), 200U * 150U * 3U);
  double alpha = 0.0;
  for (const float a : images->alpha) alpha += static_cast<double>(a) / (200.0 * 150.0);
  EXPECT_GT(alpha, 0.6);  // after few steps
}

TEST_F(SlamSystem, GivesSamePosesAndMapInEveryRunAndOnThreads) {
  std::vector<std::string> trajectories;
  std::vector<std::vector<float>> means;
  for (const auto mode : {localization::RunMode::sequential, localization::RunMode::sequential,
                          localization::RunMode::replay}) {
    System system(options(mode), rig_);
    process_all(system);
    trajectories.push_back(tum(system.trajectory()));
    means.push_back(system.map().value().means);
  }
  EXPECT_EQ(trajectories[0], trajectories[1]);
  EXPECT_EQ(trajectories[0], trajectories[2]);
  EXPECT_EQ(means[0], means[1]);
  EXPECT_EQ(means[0], means[2]);
}

TEST_F(SlamSystem, SnapshotsAndRendersWhileItRuns) {
  System system(options(localization::RunMode::replay), rig_);
  std::atomic<bool> done = false;
  std::size_t snapshots = 0;
  std::size_t renders = 0;
  std::thread reader([&] {
    while (!done) {
      const auto map = system.map();
      if (!map) continue;
      EXPECT_EQ(map->means.size(), 3 * map->count);
      ++snapshots;
      if (system.render(view_from(system.pose().value().T_world_body))) ++renders;
    }
  });
  process_all(system);
  done = true;
  reader.join();
  EXPECT_GT(snapshots, 0U);
  EXPECT_GT(renders, 0U);
}

TEST_F(SlamSystem, LocalizesWithoutMapWhenMappingIsDisabled) {
  Options without = options();
  without.mapping.enabled = MapSwitch::off;
  System system(without, rig_);
  process_all(system);
  EXPECT_GT(system.trajectory().size(), 40U);
  EXPECT_FALSE(system.map());
  EXPECT_FALSE(system.render(view_from(SE3::identity())));
}

TEST_F(SlamSystem, ReportsInvalidInputAsError) {
  Options contradictory = options();
  contradictory.localization.sensors.use = {"dvl", "pressure"};
  EXPECT_THROW(System(contradictory, rig_), Error);
  EXPECT_THROW(System(options(), Rig{}), Error);
  System system(options(), rig_);
  RenderView view = view_from(SE3::identity());
  view.camera.width = 0;
  EXPECT_THROW(system.render(view), InputError);
}

}  // namespace
}  // namespace apvi::slam
