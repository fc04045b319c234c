// SPDX-License-Identifier: BSD-3-Clause
#include "loop_closure/level_pose.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "apvi/geometry/so3.hpp"
#include "core/random.hpp"

namespace apvi::loop_closure {
namespace {

constexpr double kSigma = 1.0 / 210.0;
const SE3 kMap{so3::exp({0.0, 0.0, 2.1}), {40.0, -25.0, 1.5}};  // in the world

/// Points some 2 m in front of a tilted camera; every `outlier`-th ray is a wrong one.
LevelView view_of(Random& random, const Eigen::Vector3d& moved, int points, double noise,
                  int outlier) {
  LevelView view{{so3::exp({2.4, 0.3, 0.8}), kMap.translation + moved}, {}};
  for (int k = 0; k < points; ++k) {
    const Eigen::Vector3d p(random.uniform(-1.2, 1.2), random.uniform(-0.9, 0.9),
                            random.uniform(1.5, 2.5));
    Eigen::Vector2d ray = p.hnormalized();
    ray += Eigen::Vector2d(random.normal(0.0, noise), random.normal(0.0, noise));
    if (k % outlier == outlier - 1) ray = {random.uniform(-0.7, 0.7), random.uniform(-0.5, 0.5)};
    view.seen.push_back({kMap.inverse() * (view.T_world_camera * p), ray});
  }
  return view;
}

TEST(LevelPose, TwoPointsGiveThePoseAmongOutliers) {
  Random random(1);
  const LevelView view = view_of(random, {1.0, 2.0, 3.0}, 40, 0.0, 2);
  const auto pose = sample_level_pose(view, kSigma);
  ASSERT_TRUE(pose.has_value());
  EXPECT_LT((pose->translation - kMap.translation).norm(), 1e-6);
  EXPECT_LT(so3::angle_between(pose->rotation, kMap.rotation), 1e-6);
  EXPECT_GE(fitting_points(view, *pose, kSigma).size(), 20U);
  EXPECT_LT(fitting_points(view, *pose, kSigma).size(), 25U);
}

TEST(LevelPose, OnePointGivesNoPose) {
  Random random(2);
  const LevelView view = view_of(random, {1.0, 2.0, 3.0}, 1, 0.0, 99);
  EXPECT_FALSE(sample_level_pose(view, kSigma).has_value());
  EXPECT_FALSE(fit_level_pose({view}, kMap, kSigma).has_value());
  EXPECT_FALSE(fit_level_pose({}, kMap, kSigma).has_value());
}

TEST(LevelPose, SeveralViewsOfAnInexactStartConverge) {
  Random random(3);
  SE3 start = kMap;
  start.rotation = so3::exp({0.0, 0.0, 0.05}) * start.rotation;
  start.translation += Eigen::Vector3d(0.1, -0.1, 0.05);
  const auto pose = fit_level_pose({view_of(random, {1.0, 2.0, 3.0}, 20, 0.0, 99),
                                    view_of(random, {1.2, 2.3, 3.1}, 20, 0.0, 99)},
                                   start, kSigma);
  ASSERT_TRUE(pose.has_value());
  EXPECT_LT((pose->T_world_map.translation - kMap.translation).norm(), 1e-5);
  EXPECT_LT(so3::angle_between(pose->T_world_map.rotation, kMap.rotation), 1e-6);
}

// Of the camera in the map, by many draws of the noise. The robust loss takes a little weight from
// every point, which the covariance knows; a small part of the points exceeds its scale.
TEST(LevelPose, CovarianceIsTheScatterOfTheResult) {
  constexpr int kDraws = 400;
  Random random(4);
  Eigen::Matrix4d scatter = Eigen::Matrix4d::Zero();
  Eigen::Matrix4d reported = Eigen::Matrix4d::Zero();
  for (int k = 0; k < kDraws; ++k) {
    const LevelView view = view_of(random, {1.0, 2.0, 3.0}, 30, kSigma, 99);
    const auto pose = fit_level_pose({view}, kMap, kSigma);
    ASSERT_TRUE(pose.has_value());
    const Eigen::Vector3d& camera = view.T_world_camera.translation;
    Eigen::Vector4d error;
    error.head<3>() = pose->T_world_map * (kMap.inverse() * camera) - camera;
    error[3] = so3::yaw(pose->T_world_map.rotation * kMap.rotation.conjugate());
    scatter += error * error.transpose() / kDraws;
    reported += pose->covariance / kDraws;
  }
  for (int i = 0; i < 4; ++i) {
    const double ratio = std::sqrt(scatter(i, i) / reported(i, i));
    EXPECT_GT(ratio, 0.6) << i;
    EXPECT_LT(ratio, 1.3) << i;
  }
}

}  // namespace
}  // namespace apvi::loop_closure
