// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/alignment/map_odom_transform.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "mapping/appearance/view_corrections.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

Tensor pose(double x, double yaw) {
  return corrected_pose(torch::eye(4, torch::kFloat64),
                        torch::tensor({x, 0.2, -0.1, 0.1, yaw, 0.3}, torch::kFloat64));
}

TEST(MapOdomTransform, ConvertsPosesAndPointsConsistently) {
  MapOdomTransform map_odom({.translation_m = 0.01, .rotation_rad = 0.001});
  map_odom.add();
  EXPECT_TRUE(torch::allclose(map_odom.pose_in_map(0, pose(1.0, 0.5)), pose(1.0, 0.5)));
  map_odom.add();
  const Tensor odometry = pose(1.0, 0.5);
  const Tensor map = pose(1.1, 0.52);
  map_odom.register_newest(1000, odometry, map);
  map_odom.add();
  EXPECT_FALSE(map_odom.is_registered(0));
  EXPECT_TRUE(map_odom.is_registered(1));
  EXPECT_FALSE(map_odom.is_registered(2));
  EXPECT_TRUE(torch::allclose(map_odom.pose_in_map(0, odometry),
                              odometry));  // earlier keyframes are unchanged
  EXPECT_TRUE(torch::allclose(map_odom.pose_in_map(1, odometry), map));
  EXPECT_TRUE(torch::allclose(map_odom.pose_in_map(2, odometry), map));
  EXPECT_TRUE(torch::allclose(map_odom.pose_in_odometry(2, map), odometry));
  // A point has the same camera coordinates in both frames.
  const Tensor point = torch::tensor({{0.3, -0.4, 2.0}}, torch::kFloat64);
  const auto in_camera = [](const Tensor& T, const Tensor& p) {
    return T.slice(0, 0, 3).slice(1, 0, 3).mv(p[0]) + T.slice(0, 0, 3).select(1, 3);
  };
  EXPECT_TRUE(torch::allclose(in_camera(odometry, point),
                              in_camera(map, map_odom.points_in_map(point)), 0.0, 1e-9));
}

TEST(MapOdomTransform, SigmasGrowWithTimeSinceTheLastRegistration) {
  MapOdomTransform map_odom({.translation_m = 0.01, .rotation_rad = 0.001});
  map_odom.add();
  map_odom.register_newest(10'000'000'000, pose(0.0, 0.0), pose(0.0, 0.0));
  EXPECT_NEAR(map_odom.sigmas(14'000'000'000).translation_m, 0.04, 1e-9);
  EXPECT_NEAR(map_odom.sigmas(14'000'000'000).rotation_rad, 0.004, 1e-9);
  EXPECT_GT(map_odom.sigmas(10'000'000'001).translation_m, 0.001);
  EXPECT_LT(map_odom.sigmas(9'000'000'000'000).translation_m, 1.0);
}

TEST(MapOdomTransform, AppliesLoopCorrections) {
  MapOdomTransform map_odom({.translation_m = 0.01, .rotation_rad = 0.001});
  map_odom.add();
  map_odom.register_newest(1000, pose(1.0, 0.5), pose(1.1, 0.52));
  map_odom.add();
  const Tensor motion = pose(0.3, 0.1);  // of the map
  const Tensor before = map_odom.pose_in_map(1, pose(2.0, 0.0));
  map_odom.apply_correction(1, motion);
  EXPECT_TRUE(
      torch::allclose(map_odom.pose_in_map(1, pose(2.0, 0.0)), before.mm(rigid_inverse(motion))));
  EXPECT_TRUE(
      torch::allclose(map_odom.pose_in_map(0, pose(1.0, 0.5)), pose(1.1, 0.52)));  // not corrected
  map_odom.correct_current(motion);
  map_odom.add();
  EXPECT_TRUE(
      torch::allclose(map_odom.pose_in_map(2, pose(2.0, 0.0)), before.mm(rigid_inverse(motion))));
}

TEST(MapOdomTransform, StaysRigidOverThousandsOfCorrections) {
  MapOdomTransform map_odom({.translation_m = 0.01, .rotation_rad = 0.001});
  Tensor odometry = pose(0.0, 0.0);
  odometry.slice(0, 0, 3).slice(1, 0, 3) *= 1.0 + 1e-8;  // with a rounding error
  for (int i = 0; i < 3000; ++i) {
    map_odom.add();
    map_odom.register_newest(i, odometry,
                             map_odom.pose_in_map(static_cast<std::size_t>(i), odometry));
  }
  EXPECT_TRUE(is_rigid(map_odom.pose_in_map(2999, pose(0.0, 0.0))));
}

}  // namespace
}  // namespace apvi::mapping
