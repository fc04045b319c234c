// SPDX-License-Identifier: BSD-3-Clause
#include "depth/quadtree.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <array>
#include <set>
#include <vector>

#include "core/random.hpp"

namespace apvi::depth {
namespace {

using torch::Tensor;

/// Uniform patches of all sizes with noise in places.
Tensor patchwork(Random& random, int width, int height) {
  Tensor image = torch::full({height, width}, 0.4, torch::kFloat32);
  for (int k = 0; k < 12; ++k) {
    const int x = static_cast<int>(random.uniform() * width);
    const int y = static_cast<int>(random.uniform() * height);
    const int w = 1 + static_cast<int>(random.uniform() * 40);
    const int h = 1 + static_cast<int>(random.uniform() * 40);
    image.slice(0, y, std::min(y + h, height))
        .slice(1, x, std::min(x + w, width))
        .fill_(random.uniform());
  }
  return image;
}

struct Size {
  int width;
  int height;
};
constexpr std::array<Size, 7> kSizes = {
    {{64, 48}, {65, 49}, {16, 16}, {15, 17}, {3, 5}, {1, 1}, {83, 31}}};

TEST(Quadtree, CoversEveryPixelOnce) {
  Random random(1);
  for (int k = 0; k < 40; ++k) {
    for (const Size size : kSizes) {
      Tensor covered = torch::zeros({size.height, size.width}, torch::kInt32);
      for (const Block& b :
           build_quadtree(patchwork(random, size.width, size.height), QuadtreeOptions{})) {
        covered.slice(0, b.y, b.y + b.height).slice(1, b.x, b.x + b.width) += 1;
      }
      ASSERT_TRUE((covered == 1).all().item<bool>()) << size.width << " x " << size.height;
    }
  }
}

TEST(Quadtree, BlocksAreUniformOrMinimal) {
  Random random(2);
  const QuadtreeOptions options;
  std::set<int> sizes;
  for (int k = 0; k < 20; ++k) {
    const Tensor image = patchwork(random, 83, 61);
    for (const Block& b : build_quadtree(image, options)) {
      const Tensor pixels = image.slice(0, b.y, b.y + b.height).slice(1, b.x, b.x + b.width);
      const double farthest = (pixels - pixels.mean()).abs().max().item<double>();
      ASSERT_TRUE(b.size == options.min_block_px || farthest <= options.split_threshold + 1e-6);
      ASSERT_EQ(b.x % b.size, 0);
      ASSERT_EQ(b.y % b.size, 0);
      sizes.insert(b.size);
    }
  }
  EXPECT_EQ(sizes, (std::set<int>{4, 8, 16}));
}

TEST(Quadtree, SplitsOnlyNonUniformBlocks) {
  Tensor image = torch::full({32, 32}, 0.5, torch::kFloat32);
  image[20][5] = 0.9;
  const std::vector<Block> blocks = build_quadtree(image, QuadtreeOptions{});
  ASSERT_EQ(blocks.size(), 3U + 3U + 4U);
  const auto with_dot = std::find_if(blocks.begin(), blocks.end(), [](const Block& b) {
    return b.x <= 5 && 5 < b.x + b.width && b.y <= 20 && 20 < b.y + b.height;
  });
  EXPECT_EQ(with_dot->size, 4);
}

/// Levels of 16, 8 and 6 px as in the paper.
constexpr QuadtreeOptions kPaper = {.max_block_px = 16, .min_block_px = 6};

TEST(Quadtree, LastSplitLeavesNarrowBlocksIfTheSmallestDoesNotDivideItsParent) {
  Tensor image = torch::full({16, 16}, 0.5, torch::kFloat32);
  image[9][10] = 0.9;
  const std::vector<Block> blocks = build_quadtree(image, kPaper);
  ASSERT_EQ(blocks.size(), 3U + 4U);
  const auto area = [](const Block& b) { return std::array<int, 4>{b.x, b.y, b.width, b.height}; };
  EXPECT_EQ(area(blocks[3]), (std::array<int, 4>{8, 8, 6, 6}));
  EXPECT_EQ(area(blocks[4]), (std::array<int, 4>{14, 8, 2, 6}));
  EXPECT_EQ(area(blocks[5]), (std::array<int, 4>{8, 14, 6, 2}));
  EXPECT_EQ(area(blocks[6]), (std::array<int, 4>{14, 14, 2, 2}));
}

TEST(Quadtree, CoversEveryPixelOnceForEverySmallestBlock) {
  Random random(5);
  for (int smallest = 1; smallest <= 16; ++smallest) {
    Tensor covered = torch::zeros({31, 83}, torch::kInt32);
    for (const Block& b : build_quadtree(patchwork(random, 83, 31),
                                         {.max_block_px = 16, .min_block_px = smallest})) {
      covered.slice(0, b.y, b.y + b.height).slice(1, b.x, b.x + b.width) += 1;
    }
    ASSERT_TRUE((covered == 1).all().item<bool>()) << smallest;
  }
}

class QuadtreeGraph : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(SmallestBlocks, QuadtreeGraph, testing::Values(4, 5, 6));

TEST_P(QuadtreeGraph, NeighborsShareAnEdge) {
  Random random(3);
  for (const Size size : kSizes) {
    const auto blocks = build_quadtree(patchwork(random, size.width, size.height),
                                       {.max_block_px = 16, .min_block_px = GetParam()});
    const BlockGraph graph = neighbor_graph(blocks, size.width, size.height);
    ASSERT_EQ(graph.offsets.size(), blocks.size() + 1);
    ASSERT_EQ(static_cast<std::size_t>(graph.offsets.back()), graph.neighbors.size());
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      std::vector<std::int32_t> expected;
      for (std::size_t j = 0; j < blocks.size(); ++j) {
        const Block& a = blocks[i];
        const Block& b = blocks[j];
        const int wide = std::min(a.x + a.width, b.x + b.width) - std::max(a.x, b.x);
        const int high = std::min(a.y + a.height, b.y + b.height) - std::max(a.y, b.y);
        if ((wide == 0 && high > 0) || (wide > 0 && high == 0)) {
          expected.push_back(static_cast<std::int32_t>(j));
        }
      }
      const std::vector<std::int32_t> found(graph.neighbors.begin() + graph.offsets[i],
                                            graph.neighbors.begin() + graph.offsets[i + 1]);
      ASSERT_EQ(found, expected) << "block " << i << " of " << size.width << " x " << size.height;
    }
  }
}

TEST(Quadtree, ReverseEdgesAreConsistent) {
  Random random(4);
  const auto blocks = build_quadtree(patchwork(random, 83, 61), QuadtreeOptions{});
  const BlockGraph graph = neighbor_graph(blocks, 83, 61);
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    for (auto e = graph.offsets[i]; e < graph.offsets[i + 1]; ++e) {
      const auto back = graph.reverse[static_cast<std::size_t>(e)];
      const auto other = static_cast<std::size_t>(graph.neighbors[static_cast<std::size_t>(e)]);
      EXPECT_EQ(graph.neighbors[static_cast<std::size_t>(back)], static_cast<std::int32_t>(i));
      EXPECT_GE(back, graph.offsets[other]);
      EXPECT_LT(back, graph.offsets[other + 1]);
    }
  }
}

TEST(Quadtree, RejectsInvalidBlockSizes) {
  const Tensor image = torch::zeros({16, 16}, torch::kFloat32);
  EXPECT_THROW(build_quadtree(image, QuadtreeOptions{.max_block_px = 12, .min_block_px = 4}),
               c10::Error);
  EXPECT_THROW(build_quadtree(image, QuadtreeOptions{.max_block_px = 4, .min_block_px = 8}),
               c10::Error);
  EXPECT_THROW(build_quadtree(image.to(torch::kFloat64), QuadtreeOptions{}), c10::Error);
}

}  // namespace
}  // namespace apvi::depth
