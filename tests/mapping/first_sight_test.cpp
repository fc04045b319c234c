// SPDX-License-Identifier: BSD-3-Clause
#include "apvi/mapping/first_sight.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kSecond = 1'000'000'000;

splat::View view_at(double x) {
  return {.intrinsics = test::small_camera(),
          .T_camera_world = test::camera_at(x, 0.0),
          .pose_delta = {}};
}

splat::Gaussians moved_by(splat::Gaussians gaussians, double y) {
  gaussians.means = gaussians.means + torch::tensor({0.0, y, 0.0});
  return gaussians;
}

TEST(FirstSight, KeepsAPlaceAsItWasFirstSeen) {
  const splat::Gaussians wall = test::wall_of_gaussians(2000);
  FirstSight memory(100000);
  memory.remember(wall, view_at(0.0), 1 * kSecond);
  const std::int64_t first = memory.gaussians().size();
  EXPECT_GT(first, 100);
  EXPECT_LT(first, wall.size());  // what the picture does not show is not known
  // A little later there may be more of it; long after, another version of it is not believed.
  memory.remember(wall, view_at(0.05), 3 * kSecond);
  const std::int64_t second = memory.gaussians().size();
  EXPECT_GT(second, first + 100);
  const Tensor before = memory.gaussians().means.clone();
  memory.remember(moved_by(wall, 0.02), view_at(0.0), 60 * kSecond);
  EXPECT_LT(memory.gaussians().size(), second + first / 20);
  EXPECT_TRUE(torch::equal(memory.gaussians().means.slice(0, 0, second), before));
}

TEST(FirstSight, TakesInWhatIsNewLongAfter) {
  const splat::Gaussians wall = test::wall_of_gaussians(2000);
  FirstSight memory(100000);
  memory.remember(wall, view_at(-1.0), 1 * kSecond);
  const std::int64_t left = memory.gaussians().size();
  memory.remember(wall, view_at(1.0), 60 * kSecond);
  EXPECT_GT(memory.gaussians().size(), left + left / 4);
}

TEST(FirstSight, MovesWithTheKeyframeThatAClosedLoopMoves) {
  const splat::Gaussians wall = test::wall_of_gaussians(2000);
  FirstSight memory(100000);
  memory.remember(wall, view_at(-1.0), 1 * kSecond);
  const std::int64_t first = memory.gaussians().size();
  memory.remember(wall, view_at(1.0), 60 * kSecond);
  const Tensor before = memory.gaussians().means.clone();
  Tensor motion = torch::eye(4, torch::kFloat64);
  motion[0][3] = 0.25;
  memory.move(60 * kSecond, motion);
  memory.move(30 * kSecond, motion);  // of which nothing is known
  const Tensor moved = memory.gaussians().means - before;
  EXPECT_EQ(moved.slice(0, 0, first).abs().max().item<float>(), 0.0F);
  EXPECT_TRUE(torch::allclose(moved.slice(0, first).select(1, 0), torch::tensor(0.25F), 0.0, 1e-5));
  EXPECT_LT(moved.slice(0, first).slice(1, 1).abs().max().item<float>(), 1e-5F);
}

TEST(FirstSight, KeepsToItsBudgetAndForgetsTheOldest) {
  const splat::Gaussians wall = test::wall_of_gaussians(2000);
  FirstSight memory(300);
  for (int i = 0; i < 5; ++i) memory.remember(wall, view_at(0.1 * i), (i + 1) * kSecond);
  EXPECT_EQ(memory.gaussians().size(), 300);
  EXPECT_EQ(memory.gaussians().sh_rest.size(0), 300);
}

}  // namespace
}  // namespace apvi::mapping
