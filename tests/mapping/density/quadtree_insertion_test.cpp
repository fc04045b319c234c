// SPDX-License-Identifier: BSD-3-Clause
#include "mapping/density/quadtree_insertion.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "support/torch_reference.hpp"

namespace apvi::mapping {
namespace {

using torch::Tensor;

/// Four blocks of 16 px with confident depth.
depth::DepthEstimate four_blocks() {
  depth::DepthEstimate estimate;
  for (int i = 0; i < 4; ++i) {
    estimate.blocks.push_back({16 * (i % 2), 16 * (i / 2), 16, 16, 16});
  }
  estimate.points = torch::tensor({{8.0F, 8.0F}, {24.0F, 8.0F}, {8.0F, 24.0F}, {24.0F, 24.0F}});
  estimate.depth = torch::tensor({1.0F, 2.0F, 3.0F, 4.0F});
  estimate.confident = torch::ones({4}, torch::kBool);
  return estimate;
}

struct Inputs {
  Tensor rendered = torch::zeros({32, 32, 3});
  Tensor alpha = torch::zeros({32, 32});
  Tensor image = torch::full({32, 32, 3}, 0.5F);
  Tensor points = torch::empty({0, 2}, torch::kFloat64);
};

std::vector<bool> filled(const depth::DepthEstimate& estimate, const Inputs& d) {
  const Tensor depths = insertion_depths(estimate, InsertionDepth::block);
  const Tensor which = blocks_to_fill(estimate, depths, d.points, d.rendered, d.alpha, d.image, {});
  std::vector<bool> result;
  for (std::int64_t i = 0; i < which.size(0); ++i) result.push_back(which[i].item<bool>());
  return result;
}

using Four = std::vector<bool>;

TEST(BlocksToFill, IncludesAllBlocksOfAnEmptyMap) {
  EXPECT_EQ(filled(four_blocks(), {}), Four({true, true, true, true}));
}

TEST(BlocksToFill, ExcludesBlocksWithoutConfidentDepth) {
  depth::DepthEstimate estimate = four_blocks();
  estimate.confident[1] = false;
  estimate.depth[2] = 0.0F;
  EXPECT_EQ(filled(estimate, {}), Four({true, false, false, true}));
}

TEST(BlocksToFill, ExcludesBlocksWithASparsePoint) {
  Inputs inputs;
  inputs.points =
      torch::tensor({{3.0, 30.9}, {16.0, 15.9}, {-5.0, 3.0}, {400.0, 3.0}}, torch::kFloat64);
  EXPECT_EQ(filled(four_blocks(), inputs), Four({true, false, false, true}));
}

TEST(BlocksToFill, ExcludesCoveredBlocks) {
  Inputs inputs;
  inputs.alpha.slice(1, 0, 16).fill_(0.99F);                            // left: opaque
  inputs.rendered.slice(0, 0, 16).copy_(inputs.image.slice(0, 0, 16));  // top: correct color
  EXPECT_EQ(filled(four_blocks(), inputs), Four({false, true, true, true}));
}

TEST(BlocksToFill, SeedsHaveTheBlocksCentersAndSizes) {
  const depth::DepthEstimate estimate = four_blocks();
  const Seeds seeds =
      seeds_from_blocks(estimate, estimate.depth, torch::tensor({false, true, false, true}), 0.3);
  ASSERT_EQ(seeds.size(), 2);
  EXPECT_TRUE(test::tensors_near(seeds.pixels,
                                 torch::tensor({{24.0, 8.0}, {24.0, 24.0}}, torch::kFloat64), 0));
  EXPECT_TRUE(test::tensors_near(seeds.depths, torch::tensor({2.0, 4.0}, torch::kFloat64), 0));
  EXPECT_DOUBLE_EQ(seeds.radii_px[0].item<double>(), 8.0);
  EXPECT_DOUBLE_EQ(seeds.opacities[0].item<double>(), 0.3);
}

TEST(InsertionDepths, UpsampledDepthFillsBlocksWithoutConfidentDepth) {
  depth::DepthEstimate estimate = four_blocks();
  estimate.confident[1] = false;
  estimate.points = estimate.points - 7.5F;  // top-left pixels
  estimate.dense = torch::full({32, 32}, 9.0F);
  estimate.dense[0][16] = 2.5F;
  estimate.dense[16][0] = 0.0F;
  EXPECT_TRUE(torch::equal(insertion_depths(estimate, InsertionDepth::block),
                           torch::tensor({1.0F, 0.0F, 3.0F, 4.0F})));
  EXPECT_TRUE(torch::equal(insertion_depths(estimate, InsertionDepth::upsampled),
                           torch::tensor({9.0F, 2.5F, 0.0F, 9.0F})));
  const Tensor depths = insertion_depths(estimate, InsertionDepth::upsampled);
  const Inputs empty;
  const Tensor which =
      blocks_to_fill(estimate, depths, empty.points, empty.rendered, empty.alpha, empty.image, {});
  EXPECT_TRUE(torch::equal(which, torch::tensor({true, true, false, true})));
  const Seeds seeds = seeds_from_blocks(estimate, depths, which, 0.1);
  EXPECT_TRUE(test::tensors_near(seeds.depths, torch::tensor({9.0, 2.5, 9.0}, torch::kFloat64), 0));
}

TEST(InFreeSpace, SelectsGaussiansInFrontOfConfidentDepth) {
  depth::DepthEstimate estimate = four_blocks();
  estimate.confident[3] = false;
  const gaussians::View view = {
      .intrinsics = {.fx = 32.0, .fy = 32.0, .cx = 16.0, .cy = 16.0, .width = 32, .height = 32},
      .T_camera_world = torch::eye(4, torch::kFloat64),
      .pose_delta = {}};
  const auto at = [](float u, float v, float z) {  // pixel and depth
    return torch::tensor({(u - 16.0F) / 32.0F * z, (v - 16.0F) / 32.0F * z, z});
  };
  const Tensor means =
      torch::stack({at(24, 8, 1.5F), at(24, 8, 1.7F), at(24, 8, 2.5F), at(8, 24, 2.3F),
                    at(8, 8, 0.9F), at(24, 24, 1.0F), at(40, 8, 1.0F), at(24, 8, -1.0F)});
  const Tensor expected =
      torch::tensor({true, false, false, true, false, false, false, false}, torch::kBool);
  EXPECT_TRUE(torch::equal(in_free_space(estimate, view, means, 0.8), expected));
  EXPECT_FALSE(in_free_space(estimate, view, means, 0.0).any().item<bool>());
}

void expect_direct_means(const Tensor& images, const std::vector<depth::Block>& blocks) {
  const Tensor means = block_means(images, blocks);
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const depth::Block& b = blocks[i];
    const Tensor covered = images.slice(1, b.y, b.y + b.height).slice(2, b.x, b.x + b.width);
    EXPECT_TRUE(test::tensors_near(means.select(1, static_cast<std::int64_t>(i)),
                                   covered.mean({1, 2}), 1e-6));
  }
}

TEST(BlockMeans, MatchDirectMeansInBlocksThatDoNotDivideTheirParent) {
  torch::manual_seed(3);
  const Tensor images = torch::rand({2, 16, 16});
  const std::vector<depth::Block> blocks =
      depth::build_quadtree(images[0].contiguous(), {.max_block_px = 16, .min_block_px = 6});
  ASSERT_EQ(blocks.size(), 16U);
  expect_direct_means(images, blocks);
}

TEST(BlockMeans, MatchDirectMeans) {
  torch::manual_seed(2);
  const Tensor images = torch::rand({2, 20, 30});
  const std::vector<depth::Block> blocks = {
      {0, 0, 16, 16, 16}, {16, 16, 16, 14, 4}, {24, 8, 8, 6, 8}, {28, 16, 4, 2, 4}};
  expect_direct_means(images, blocks);
}

TEST(BlocksInScene, ShowNothingThatIsHidden) {
  const Tensor scene = torch::ones({20, 30}, torch::kBool);
  scene[3][27] = false;
  const std::vector<depth::Block> blocks = {
      {0, 0, 16, 16, 16}, {24, 0, 8, 6, 8}, {28, 16, 4, 2, 4}};
  EXPECT_TRUE(torch::equal(blocks_in_scene(scene, blocks), torch::tensor({true, false, true})));
}

}  // namespace
}  // namespace apvi::mapping
