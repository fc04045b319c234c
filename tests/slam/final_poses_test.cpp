// SPDX-License-Identifier: BSD-3-Clause
#include "slam/final_poses.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "apvi/geometry/so3.hpp"
#include "slam/camera_conversion.hpp"

namespace apvi::slam {
namespace {

const SE3 kMotion{so3::exp({0.0, 0.0, 0.1}), {0.2, -0.1, 0.05}};

/// On a circle.
SE3 camera(int i) {
  return {so3::exp({0.0, 0.3, 0.0}), {std::cos(0.5 * i), std::sin(0.5 * i), -2.0}};
}

/// Six keyframes; the third one is held out.
mapping::KeyframeStore keyframes() {
  mapping::KeyframeStore store;
  for (int i = 0; i < 6; ++i) {
    mapping::Keyframe keyframe;
    keyframe.stamp_ns = 100 * i;
    keyframe.held_out = i == 2;
    keyframe.T_camera_world = to_tensor(camera(i).inverse());
    store.add(keyframe);
  }
  return store;
}

Trajectory final_poses(const std::vector<int>& which) {
  Trajectory poses;
  for (const int i : which) poses.poses.push_back({Stamp{100 * i}, kMotion * camera(i)});
  return poses;
}

TEST(FinalMotion, TakesTheKeyframesToTheirFinalPoses) {
  Trajectory poses = final_poses({0, 1, 2, 3, 17});
  poses.poses[2].T_world_body.translation.x() += 5.0;  // held out
  const auto motion = final_motion(keyframes(), poses);
  ASSERT_TRUE(motion);
  EXPECT_LT((motion->matrix() - kMotion.matrix()).norm(), 1e-9);
}

TEST(FinalMotion, IsNoneWithoutCommonKeyframes) {
  EXPECT_FALSE(final_motion(keyframes(), final_poses({17, 18})));
  EXPECT_FALSE(final_motion(keyframes(), {}));
}

}  // namespace
}  // namespace apvi::slam
