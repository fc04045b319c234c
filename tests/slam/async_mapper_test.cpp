// SPDX-License-Identifier: BSD-3-Clause
#include "slam/async_mapper.hpp"

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "support/posed_scene.hpp"

namespace apvi::slam {
namespace {

using mapping::MediumEstimationMethod;

Rig rig_with_small_camera() {
  Rig rig;
  CameraCalibration camera;
  camera.model = CameraModel(to_parameters(test::small_camera()));
  camera.T_body_camera = SE3::identity();
  rig.cameras.push_back(camera);
  return rig;
}

Stamp at_second(int second) {
  return {1'000'000'000LL * (second + 1)};
}

/// A frame with the image and the landmarks of a wall.
localization::MapFrame keyframe(const gaussians::Gaussians& world, int second) {
  const double x = 0.05 * second;
  localization::MapFrame frame;
  frame.stamp = frame.image_stamp = at_second(second);
  frame.image = to_image(test::render_keyframe(world, test::camera_at(x, 0.0), second).image);
  frame.T_world_body = {Eigen::Quaterniond::Identity(), {x, 0.0, 0.0}};
  const auto means = world.means.accessor<float, 2>();
  for (std::int64_t i = 0; i < world.size(); ++i) {
    const Eigen::Vector3f mean(means[i][0], means[i][1], means[i][2]);
    frame.points.push_back({.id = i, .position = mean.cast<double>(), .sigma_m = 0.01});
  }
  return frame;
}

/// Number of steps at each learning rate of the medium, in ten seconds with a keyframe each and an
/// outage of four seconds.
std::map<double, int> steps_by_rate(MappingThread thread, MediumEstimationMethod method) {
  AsyncMapperOptions options;
  options.thread = thread;
  options.mapper.medium = true;
  options.mapper.trainer.medium_estimation = method;
  options.mapper.trainer.sh_degree = 0;
  options.mapper.trainer.densify.kind = mapping::Densification::none;
  options.mapper.online.steps_per_keyframe = 3;
  options.mapper.online.medium_min_keyframes = 1;
  const AsyncMapper* observed = nullptr;
  std::map<double, int> steps;
  std::int64_t before = 0;
  const auto count = [&] {
    const mapping::Mapper& mapper = observed->mapper();
    if (mapper.iteration() > before) ++steps[mapper.optimizer().medium_rate().value_or(0.0)];
    before = mapper.iteration();
    return false;
  };
  AsyncMapper mapper(options, rig_with_small_camera(), {.interrupted = count});
  observed = &mapper;
  const gaussians::Gaussians world = test::gaussian_wall();
  for (int second = 0; second < 10; ++second) mapper.push(keyframe(world, second));
  localization::MapFrame failure;
  failure.stamp = at_second(10);
  failure.vio_failing = true;
  mapper.push(failure);
  mapper.push(keyframe(world, 14));
  mapper.finish();
  return steps;
}

TEST(AsyncMapper, OptimizesAMediumByGradientAtTwiceTheRateDuringAnOutage) {
  for (const MappingThread thread : {MappingThread::none, MappingThread::blocking}) {
    std::map<double, int> steps = steps_by_rate(thread, MediumEstimationMethod::gradient);
    EXPECT_EQ(steps.size(), 2U);
    EXPECT_NEAR(steps[2e-2], 12, 1);  // as many as four keyframes get
    EXPECT_NEAR(steps[1e-2], 33, 2);
  }
}

AsyncMapperOptions small_map() {
  AsyncMapperOptions options;
  options.mapper.medium = false;
  options.mapper.trainer.sh_degree = 0;
  options.mapper.trainer.densify.kind = mapping::Densification::none;
  options.mapper.online.steps_per_keyframe = 1;
  return options;
}

TEST(AsyncMapper, FollowsThePoseGraphOfLocalizationAndClosesNoLoopsItself) {
  const auto shift = [](double x) { return SE3{Eigen::Quaterniond::Identity(), {x, 0.0, 0.0}}; };
  const gaussians::Gaussians world = test::gaussian_wall();
  for (const MappingThread thread : {MappingThread::none, MappingThread::blocking}) {
    AsyncMapperOptions options = small_map();
    options.thread = thread;
    options.loop_closure.method = LoopClosureMethod::automatic;
    AsyncMapper mapper(options, rig_with_small_camera(), {});
    const auto log = std::make_shared<loop_closure::CorrectionLog>();
    for (int second = 0; second < 4; ++second) {
      localization::MapFrame frame = keyframe(world, second);
      frame.corrections = log;
      frame.graph_keyframes = static_cast<std::size_t>(second);  // the first image is before it
      if (second == 1) log->publish({}, 0);
      if (second == 2) log->publish({{at_second(1), shift(0.1)}, {at_second(2), shift(0.2)}}, 7);
      if (second == 3) log->publish({}, 7);
      mapper.push(std::move(frame));
    }
    log->publish({{at_second(3), shift(0.4)}}, 8);
    mapper.finish();
    ASSERT_EQ(mapper.failure(), nullptr);
    const std::vector<double> moved = {0.1, 0.1, 0.2, 0.6};
    const Trajectory keyframes = mapper.keyframes();
    ASSERT_EQ(keyframes.size(), moved.size());
    for (std::size_t k = 0; k < moved.size(); ++k) {
      const double x = keyframes.poses[k].T_world_body.translation.x();
      EXPECT_NEAR(x, 0.05 * static_cast<double>(k) + moved[k], 1e-9) << k;
    }
    EXPECT_EQ(mapper.closed_loops(), 8U);
  }
}

TEST(AsyncMapper, KeyframesAndTheRigGiveTheCamerasAlsoAfterSelfCalibration) {
  const gaussians::Gaussians world = test::gaussian_wall();
  AsyncMapper mapper(small_map(), rig_with_small_camera(), {});
  for (int second = 0; second < 3; ++second) {
    localization::MapFrame frame = keyframe(world, second);
    const SE3 mounting{Eigen::Quaterniond::Identity(), {0.0, 0.01 * second, 0.0}};
    frame.T_body_camera = mounting;
    frame.T_world_body = frame.T_world_body * mounting.inverse();
    mapper.push(std::move(frame));
  }
  mapper.finish();
  const Trajectory keyframes = mapper.keyframes();
  ASSERT_EQ(keyframes.size(), 3U);
  for (const StampedPose& pose : keyframes.poses) {
    EXPECT_NEAR(pose.T_world_body.translation.y(), 0.0, 1e-9);
  }
}

TEST(AsyncMapper, AutoLoopClosureIsThePoseGraphUnlessALampHasNone) {
  using enum LoopClosureMethod;
  EXPECT_EQ(resolve_loop_closure_method(automatic, true, true), pose_graph);
  EXPECT_EQ(resolve_loop_closure_method(automatic, false, false), pose_graph);
  EXPECT_EQ(resolve_loop_closure_method(automatic, false, true), alignment);
  for (const LoopClosureMethod asked : {pose_graph, alignment, none}) {
    EXPECT_EQ(resolve_loop_closure_method(asked, true, true), asked);
  }
}

TEST(AsyncMapper, ReportsTheProgressOfTheRefinement) {
  AsyncMapperOptions options = small_map();
  options.mapper.trainer.final_iterations = 4;
  std::vector<FinalProgress> reports;
  const auto report = [&reports](const FinalProgress& progress) { reports.push_back(progress); };
  AsyncMapper mapper(options, rig_with_small_camera(), {.final_progress = report});
  const gaussians::Gaussians world = test::gaussian_wall();
  for (int second = 0; second < 3; ++second) mapper.push(keyframe(world, second));
  mapper.finish();
  EXPECT_TRUE(mapper.refine());
  ASSERT_EQ(reports.size(), 6U);  // before, after each step, at the end
  for (std::size_t i = 0; i < reports.size(); ++i) {
    EXPECT_EQ(reports[i].work, FinalWork::refining);
    EXPECT_EQ(reports[i].ended, i == 5);
  }
  EXPECT_EQ(reports[0].fraction, 0.0);
  EXPECT_EQ(reports[4].fraction, 1.0);
  EXPECT_GT(reports[4].loss, 0.0);
}

TEST(AsyncMapper, DoesNotOptimizeDuringAnOutageWhenTheMediumIsFitted) {
  const std::map<double, int> steps =
      steps_by_rate(MappingThread::none, MediumEstimationMethod::fit);
  int sum = 0;
  for (const auto& [rate, count] : steps) sum += count;
  EXPECT_NEAR(sum, 33, 1);
}

}  // namespace
}  // namespace apvi::slam
