// SPDX-License-Identifier: BSD-3-Clause
#include "runs/maps/stored_map.hpp"

#include <gtest/gtest.h>

#include "apvi/io/tum.hpp"
#include "support/tmp_dir.hpp"

namespace apvi::runs {
namespace {

TEST(StoredMap, ThePathOfARunIsTheSmoothedTrajectoryElseTheFusedOneElseTheKeyframes) {
  const test::TmpDir run;
  EXPECT_TRUE(load_path(run.path()).empty());
  double x = 0.0;
  for (const char* name : {"keyframes.tum", "trajectory.tum", "trajectory_smoothed.tum"}) {
    x += 1.0;
    Trajectory path;
    path.poses.push_back({Stamp{1'000'000'000}, {Eigen::Quaterniond::Identity(), {x, 0.0, 0.0}}});
    io::write_tum(run.path() / name, path);
    const Trajectory stored = load_path(run.path());
    ASSERT_EQ(stored.size(), 1U);
    EXPECT_EQ(stored.poses.front().T_world_body.translation.x(), x) << name;
  }
}

}  // namespace
}  // namespace apvi::runs
