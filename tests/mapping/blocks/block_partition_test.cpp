// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/blocks/block_partition.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

namespace apvi::mapping {
namespace {

using torch::Tensor;

Tensor random_points(std::int64_t count) {
  torch::manual_seed(5);
  return torch::rand({count, 3}, torch::kFloat64) *
         torch::tensor({50.0, 8.0, 2.0}, torch::kFloat64);
}

TEST(BlockPartition, HasOneBlockUnlessSplit) {
  const BlockPartition whole;
  EXPECT_EQ(whole.size(), 1);
  EXPECT_TRUE((whole.block_of(random_points(10)) == 0).all().item<bool>());
}

TEST(BlockPartition, SplitsPointsIntoEqualParts) {
  const Tensor points = random_points(9000);
  for (const int blocks : {2, 3, 7}) {
    const BlockPartition partition = BlockPartition::of(points, blocks);
    ASSERT_EQ(partition.size(), blocks);
    const Tensor counts = partition.block_of(points).bincount({}, blocks);
    EXPECT_LE(counts.max().item<std::int64_t>(), 9000 / blocks + 3) << counts;
    EXPECT_GE(counts.min().item<std::int64_t>(), 9000 / blocks - 3) << counts;
  }
}

TEST(BlockPartition, SplitsAlongTheLongerSide) {
  const BlockPartition partition = BlockPartition::of(random_points(1000), 4);
  for (const auto& split : partition.splits()) EXPECT_EQ(split.axis, 0);
}

TEST(BlockPartition, IgnoresHeight) {
  const BlockPartition partition = BlockPartition::of(random_points(1000), 4);
  Tensor points = random_points(100);
  const Tensor before = partition.block_of(points);
  points.select(1, 2).add_(100.0);
  EXPECT_TRUE(torch::equal(before, partition.block_of(points)));
}

TEST(BlockPartition, CoversPositionsFarOutside) {
  const BlockPartition partition = BlockPartition::of(random_points(1000), 5);
  const Tensor far = torch::tensor({{-1e6, 0.0, 0.0}, {1e6, 1e6, 0.0}}, torch::kFloat64);
  const Tensor blocks = partition.block_of(far);
  EXPECT_EQ(blocks[0].item<std::int64_t>(), 0);
  EXPECT_EQ(blocks[1].item<std::int64_t>(), 4);
}

TEST(BlockPartition, IsRestoredFromItsSplits) {
  const Tensor points = random_points(1000);
  const BlockPartition partition = BlockPartition::of(points, 6);
  const BlockPartition restored(partition.splits());
  EXPECT_TRUE(torch::equal(partition.block_of(points), restored.block_of(points)));
  EXPECT_THROW(BlockPartition({{.axis = 0, .value = 0.0, .below = 0, .above = -1}}), c10::Error);
  EXPECT_THROW(BlockPartition({{.axis = 2, .value = 0.0, .below = -1, .above = -2}}), c10::Error);
}

TEST(BlockPartition, KeepsEqualPointsTogether) {
  const Tensor same = torch::ones({100, 3}, torch::kFloat64);
  EXPECT_EQ(BlockPartition::of(same, 4).size(), 1);
  const Tensor two = torch::cat({same, same * 2.0});
  const BlockPartition partition = BlockPartition::of(two, 4);
  EXPECT_EQ(partition.size(), 2);
  EXPECT_EQ(partition.block_of(two).sum().item<std::int64_t>(), 100);
}

}  // namespace
}  // namespace apvi::mapping
