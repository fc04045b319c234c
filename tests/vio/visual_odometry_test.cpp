// SPDX-License-Identifier: BSD-3-Clause
#include "vio/visual/visual_odometry.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "apvi/geometry/so3.hpp"
#include "apvi/geometry/trajectory.hpp"
#include "geometry/umeyama.hpp"
#include "support/simulated_dive.hpp"
#include "vio/visual/visual_start.hpp"

namespace apvi {
namespace {

using test::SimulatedDive;
using test::SimulatedDiveOptions;
using vio::Status;

vio::Config config() {
  vio::Config config;
  config.vision.pixel_sigma = 0.5 * std::numbers::sqrt2;
  config.window.max_solve_s = 1e3;
  return config;
}

// Images of a simulated dive, one by one, and the poses found in them.
class ImagesAlone {
 public:
  explicit ImagesAlone(const SimulatedDiveOptions& options)
      : dive(options), odometry(config(), SimulatedDive::rig()) {}

  vio::Result step(int k, bool visible = true) {
    const auto last = poses.empty() ? std::nullopt : std::optional(poses.poses.back().T_world_body);
    const vio::Result result = odometry.process(dive.frame(k, visible), last);
    poses.merge(result.earlier);
    if (result.has_state()) poses.merge({{result.stamp, result.state.pose()}});
    return result;
  }

  // RMS position error after alignment with scale, relative to the length of the path.
  double shape_error() const {
    std::vector<Eigen::Vector3d> found;
    std::vector<Eigen::Vector3d> truth;
    Trajectory path;
    for (int k = 0; k < dive.frames(); ++k) {
      const auto pose = poses.at(dive.frame_stamp(k), Duration{1});
      if (!pose) continue;
      found.push_back(pose->translation);
      truth.push_back(dive.truth(k).p_world);
      path.poses.push_back({dive.frame_stamp(k), dive.truth(k).pose()});
    }
    const double scale = similarity_scale(found, truth).value();
    for (Eigen::Vector3d& p : found) p *= scale;
    const SE3 T = align_rigid(found, truth).value();
    double sum = 0.0;
    for (std::size_t i = 0; i < found.size(); ++i) sum += (T * found[i] - truth[i]).squaredNorm();
    return std::sqrt(sum / static_cast<double>(found.size())) / path.path_length();
  }

  SimulatedDive dive;
  vio::VisualOdometry odometry;
  Trajectory poses;
};

TEST(VisualOdometry, FindsTheShapeOfThePathWithoutAnIMU) {
  ImagesAlone run({.duration_s = 15.0});
  int lost = 0;
  for (int k = 0; k < run.dive.frames(); ++k) lost += run.step(k).status == Status::lost ? 1 : 0;
  EXPECT_EQ(lost, 0);
  EXPECT_LT(run.shape_error(), 0.02);
}

TEST(VisualOdometry, GivesPosesOfTheFramesBeforeItsStart) {
  ImagesAlone run({.duration_s = 15.0});
  for (int k = 0; k < 40; ++k) run.step(k);
  ASSERT_EQ(run.poses.size(), 40U);
  EXPECT_EQ(run.poses.poses.front().stamp, run.dive.frame_stamp(0));
}

TEST(VisualOdometry, StartsWithTheConfiguredDistanceToTheScene) {
  ImagesAlone run({.duration_s = 15.0});
  int k = 0;
  while (run.step(k).status != Status::started) ASSERT_LT(++k, run.dive.frames());
  EXPECT_NEAR(vio::median_depth(run.odometry.window()), config().visual.start_distance, 0.1);
}

TEST(VisualOdometry, MarksItsResultsAsUpToScale) {
  ImagesAlone run({.duration_s = 15.0});
  for (int k = 0; k < 40; ++k) EXPECT_TRUE(run.step(k).up_to_scale);
}

TEST(VisualOdometry, LevelsTheWorldByTheAccelerometer) {
  ImagesAlone run({.duration_s = 15.0});
  for (int k = 0; k < 40; ++k) {
    for (const ImuSample& sample : run.dive.imu_until(k)) run.odometry.add(sample);
    run.step(k);
  }
  const auto pose = run.poses.at(run.dive.frame_stamp(30), Duration{1});
  ASSERT_TRUE(pose);
  const Eigen::Vector3d up = pose->rotation.conjugate() * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d truth =
      run.dive.truth(30).R_world_body.conjugate() * Eigen::Vector3d::UnitZ();
  EXPECT_LT(std::acos(std::min(1.0, up.dot(truth))), 0.1);  // the vehicle accelerates by 1 m/s²
}

TEST(VisualOdometry, ContinuesAtTheLastPoseAfterALoss) {
  ImagesAlone run({.duration_s = 15.0});
  int k = 0;
  for (; k < 60; ++k) run.step(k);
  const SE3 before = run.poses.poses.back().T_world_body;
  for (; k < 90; ++k) EXPECT_FALSE(run.step(k, false).has_state());
  while (run.step(k).status != Status::started) ASSERT_LT(++k, run.dive.frames());
  const SE3 after = run.poses.poses.back().T_world_body;
  EXPECT_LT((after.translation - before.translation).norm(), 1e-3);
}

TEST(VisualOdometry, WaitsForParallaxAtRest) {
  SimulatedDive dive({.duration_s = 15.0});
  vio::VisualOdometry odometry(config(), SimulatedDive::rig());
  vio::TrackedFrame frame = dive.frame(0);
  for (int k = 0; k < 40; ++k) {
    frame.stamp = dive.frame_stamp(k);
    EXPECT_EQ(odometry.process(frame, std::nullopt).status, Status::waiting);
  }
}

}  // namespace
}  // namespace apvi
