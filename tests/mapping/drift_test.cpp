// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/drift.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/mapping/view_corrections.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

Tensor pose(double x, double yaw) {
  return corrected_pose(torch::eye(4, torch::kFloat64),
                        torch::tensor({x, 0.2, -0.1, 0.1, yaw, 0.3}, torch::kFloat64));
}

TEST(Drift, IsWhatPosesAndPointsHaveInCommon) {
  Drift drift({.translation_m = 0.01, .rotation_rad = 0.001});
  drift.add();
  EXPECT_TRUE(torch::allclose(drift.in_map(0, pose(1.0, 0.5)), pose(1.0, 0.5)));
  drift.add();
  const Tensor odometry = pose(1.0, 0.5);
  const Tensor map = pose(1.1, 0.52);
  drift.found_newest(1000, odometry, map);
  drift.add();
  EXPECT_FALSE(drift.is_found(0));
  EXPECT_TRUE(drift.is_found(1));
  EXPECT_FALSE(drift.is_found(2));
  EXPECT_TRUE(torch::allclose(drift.in_map(0, odometry), odometry));  // what was, stays
  EXPECT_TRUE(torch::allclose(drift.in_map(1, odometry), map));
  EXPECT_TRUE(torch::allclose(drift.in_map(2, odometry), map));
  EXPECT_TRUE(torch::allclose(drift.in_odometry(2, map), odometry));
  // A point is seen in one place whichever world it is told in.
  const Tensor point = torch::tensor({{0.3, -0.4, 2.0}}, torch::kFloat64);
  const auto seen = [](const Tensor& T, const Tensor& p) {
    return T.slice(0, 0, 3).slice(1, 0, 3).mv(p[0]) + T.slice(0, 0, 3).select(1, 3);
  };
  EXPECT_TRUE(
      torch::allclose(seen(odometry, point), seen(map, drift.points_in_map(point)), 0.0, 1e-9));
}

TEST(Drift, MayGrowWithTheTimeSinceTheMapLastSaid) {
  Drift drift({.translation_m = 0.01, .rotation_rad = 0.001});
  drift.add();
  drift.found_newest(10'000'000'000, pose(0.0, 0.0), pose(0.0, 0.0));
  EXPECT_NEAR(drift.sigmas(14'000'000'000).translation_m, 0.04, 1e-9);
  EXPECT_NEAR(drift.sigmas(14'000'000'000).rotation_rad, 0.004, 1e-9);
  EXPECT_GT(drift.sigmas(10'000'000'001).translation_m, 0.001);
  EXPECT_LT(drift.sigmas(9'000'000'000'000).translation_m, 1.0);
}

TEST(Drift, FollowsWhereAClosedLoopMovesTheMap) {
  Drift drift({.translation_m = 0.01, .rotation_rad = 0.001});
  drift.add();
  drift.found_newest(1000, pose(1.0, 0.5), pose(1.1, 0.52));
  drift.add();
  const Tensor motion = pose(0.3, 0.1);  // of the world
  const Tensor before = drift.in_map(1, pose(2.0, 0.0));
  drift.relocate(1, motion);
  EXPECT_TRUE(torch::allclose(drift.in_map(1, pose(2.0, 0.0)), before.mm(rigid_inverse(motion))));
  EXPECT_TRUE(torch::allclose(drift.in_map(0, pose(1.0, 0.5)), pose(1.1, 0.52)));  // not named
  drift.relocate_next(motion);
  drift.add();
  EXPECT_TRUE(torch::allclose(drift.in_map(2, pose(2.0, 0.0)), before.mm(rigid_inverse(motion))));
}

TEST(Drift, StaysRigidOverThousandsOfCorrections) {
  Drift drift({.translation_m = 0.01, .rotation_rad = 0.001});
  Tensor odometry = pose(0.0, 0.0);
  odometry.slice(0, 0, 3).slice(1, 0, 3) *= 1.0 + 1e-8;  // as rounded as poses of others are
  for (int i = 0; i < 3000; ++i) {
    drift.add();
    drift.found_newest(i, odometry, drift.in_map(static_cast<std::size_t>(i), odometry));
  }
  EXPECT_TRUE(is_rigid(drift.in_map(2999, pose(0.0, 0.0))));
}

}  // namespace
}  // namespace apvi::mapping
