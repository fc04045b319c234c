// SPDX-License-Identifier: BSD-3-Clause
#include "slam/async_mapper.hpp"

#include <gtest/gtest.h>

#include <map>
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

TEST(AsyncMapper, ReportsTheProgressOfTheRefinement) {
  AsyncMapperOptions options;
  options.mapper.medium = false;
  options.mapper.trainer.sh_degree = 0;
  options.mapper.trainer.densify.kind = mapping::Densification::none;
  options.mapper.trainer.final_iterations = 4;
  options.mapper.online.steps_per_keyframe = 1;
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
