// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/loop_measurement.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"
#include "support/textured_floor.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kTilt = 0.02;  // [rad]: 4 cm at the distance of the floor
constexpr int kPoints = 40;

SE3 truth(std::size_t keyframe) {
  return keyframe == 0 ? test::camera_looking_down({0.0, 0.0, 2.0}, 0.0)
                       : test::camera_looking_down({0.3, 0.2, 2.0}, 0.5);
}

/// Two keyframes; odometry of the second has drifted in heading and position.
KeyframeGraph drifted_graph() {
  KeyframeGraph graph{KeyframeGraphOptions{}};
  const SE3 drift{so3::exp({0.0, 0.0, 0.1}), {0.4, -0.2, 0.05}};
  for (const std::size_t k : {0, 1}) {
    graph.add({.stamp = Stamp{static_cast<std::int64_t>(k) * 60'000'000'000},
               .T_world_camera = k == 0 ? truth(0) : drift * truth(1),
               .drift = {},
               .height_sigma_m = std::nullopt});
  }
  return graph;
}

/// Points of the floor as both cameras see them, and a pose that is tilted about their center.
PlaceMatch tilted_match() {
  Random random(5);
  PlaceMatch match;
  const SE3 T_now_then = truth(1).inverse() * truth(0);
  for (int i = 0; i < kPoints; ++i) {
    const Eigen::Vector3d point(random.uniform(-0.5, 0.8), random.uniform(-0.5, 0.5),
                                random.uniform(1.8, 2.1));
    match.seen.push_back({point, (T_now_then * point).hnormalized()});
  }
  const Eigen::Vector3d center(0.15, 0.0, 1.95);
  const Eigen::Quaterniond tilt = so3::exp({0.0, kTilt, 0.0});
  match.T_now_then = T_now_then * SE3{tilt, center - tilt * center};
  return match;
}

TEST(LoopMeasurement, IgnoresATiltThatImagesLeaveUncertain) {
  const PlaceMatch match = tilted_match();
  const SE3 T_from_to = truth(0).inverse() * truth(1);
  const SE3 by_images = match.T_now_then.inverse();
  ASSERT_GT((by_images.translation - T_from_to.translation).norm(), 0.03);
  const auto loop = measure_loop(drifted_graph(), 0, 1, match, 1.0 / 210.0);
  ASSERT_TRUE(loop.has_value());
  EXPECT_LT((loop->T_from_to.translation - T_from_to.translation).norm(), 1e-4);
  EXPECT_LT(so3::angle_between(loop->T_from_to.rotation, T_from_to.rotation), 1e-4);
}

TEST(LoopMeasurement, CoarseImagesAreLessCertain) {
  const auto fine = measure_loop(drifted_graph(), 0, 1, tilted_match(), 1e-4);
  const auto coarse = measure_loop(drifted_graph(), 0, 1, tilted_match(), 0.01);
  ASSERT_TRUE(fine && coarse);
  EXPECT_NEAR(fine->sigmas.horizontal_m, kLoopSigmas.horizontal_m, 1e-4);
  // One sigma of a ray is 2 cm on the floor; Cauchy's loss has half the weight at one sigma.
  EXPECT_GT(coarse->sigmas.heading_rad, 2.0 * kLoopSigmas.heading_rad);
  EXPECT_GT(coarse->sigmas.horizontal_m, 0.0075);
  EXPECT_LT(coarse->sigmas.horizontal_m, 0.02);
}

}  // namespace
}  // namespace apvi::loop_closure
