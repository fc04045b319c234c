// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/alignment/frozen_reference_map.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "support/posed_scene.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

constexpr std::int64_t kSecond = 1'000'000'000;

gaussians::View view_at(double x) {
  return {.intrinsics = test::small_camera(),
          .T_camera_world = test::camera_at(x, 0.0),
          .pose_delta = {}};
}

gaussians::Gaussians moved_by(gaussians::Gaussians gaussians, double y) {
  gaussians.means = gaussians.means + torch::tensor({0.0, y, 0.0});
  return gaussians;
}

TEST(FrozenReferenceMap, KeepsGaussiansOfTheFirstObservation) {
  const gaussians::Gaussians wall = test::gaussian_wall(2000);
  FrozenReferenceMap reference(100000);
  reference.insert(wall, view_at(0.0), 1 * kSecond);
  const std::int64_t first = reference.gaussians().size();
  EXPECT_GT(first, 100);
  EXPECT_LT(first, wall.size());  // only what the image shows
  // Soon after, more Gaussians are inserted; long after, displaced duplicates are not.
  reference.insert(wall, view_at(0.05), 3 * kSecond);
  const std::int64_t second = reference.gaussians().size();
  EXPECT_GT(second, first + 100);
  const Tensor before = reference.gaussians().means.clone();
  reference.insert(moved_by(wall, 0.02), view_at(0.0), 60 * kSecond);
  EXPECT_LT(reference.gaussians().size(), second + first / 20);
  EXPECT_TRUE(torch::equal(reference.gaussians().means.slice(0, 0, second), before));
}

TEST(FrozenReferenceMap, InsertsNewAreasLater) {
  const gaussians::Gaussians wall = test::gaussian_wall(2000);
  FrozenReferenceMap reference(100000);
  reference.insert(wall, view_at(-1.0), 1 * kSecond);
  const std::int64_t left = reference.gaussians().size();
  reference.insert(wall, view_at(1.0), 60 * kSecond);
  EXPECT_GT(reference.gaussians().size(), left + left / 4);
}

TEST(FrozenReferenceMap, MovesGaussiansOfCorrectedKeyframes) {
  const gaussians::Gaussians wall = test::gaussian_wall(2000);
  FrozenReferenceMap reference(100000);
  reference.insert(wall, view_at(-1.0), 1 * kSecond);
  const std::int64_t first = reference.gaussians().size();
  reference.insert(wall, view_at(1.0), 60 * kSecond);
  const Tensor before = reference.gaussians().means.clone();
  Tensor motion = torch::eye(4, torch::kFloat64);
  motion[0][3] = 0.25;
  reference.move(60 * kSecond, motion);
  reference.move(30 * kSecond, motion);  // no Gaussians of this stamp
  const Tensor moved = reference.gaussians().means - before;
  EXPECT_EQ(moved.slice(0, 0, first).abs().max().item<float>(), 0.0F);
  EXPECT_TRUE(torch::allclose(moved.slice(0, first).select(1, 0), torch::tensor(0.25F), 0.0, 1e-5));
  EXPECT_LT(moved.slice(0, first).slice(1, 1).abs().max().item<float>(), 1e-5F);
}

TEST(FrozenReferenceMap, DropsTheOldestWhenFull) {
  const gaussians::Gaussians wall = test::gaussian_wall(2000);
  FrozenReferenceMap reference(300);
  for (int i = 0; i < 5; ++i) reference.insert(wall, view_at(0.1 * i), (i + 1) * kSecond);
  EXPECT_EQ(reference.gaussians().size(), 300);
  EXPECT_EQ(reference.gaussians().sh_rest.size(0), 300);
}

}  // namespace
}  // namespace apvi::mapping
