// SPDX-License-Identifier: BSD-3-Clause
#include "change/clusters.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "change/surface_cells.hpp"

namespace apvi::change {
namespace {

/// Keys of cells in a row along x, at these indices.
torch::Tensor row_of_cells(const std::vector<double>& indices) {
  const torch::Tensor x = torch::tensor(indices, torch::kFloat64) + 0.5;
  return cell_keys(torch::stack({x, torch::zeros_like(x), torch::zeros_like(x)}, 1), 1.0);
}

TEST(Clusters, OneMissingCellDoesNotDivideAndTwoDo) {
  const torch::Tensor keys = row_of_cells({-1, 0, 2, 5, 6});
  const torch::Tensor all = torch::ones({5}, torch::kBool);
  const auto found = clusters(keys, all, all);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0], (std::vector<std::int64_t>{0, 1, 2}));
  EXPECT_EQ(found[1], (std::vector<std::int64_t>{3, 4}));
}

TEST(Clusters, WeakCellsJoinButDoNotConnect) {
  const torch::Tensor keys = row_of_cells({0, 1, 2, 3, 4, 5});
  const torch::Tensor strong = torch::tensor({true, false, false, false, false, false});
  const auto found = clusters(keys, strong, torch::ones({6}, torch::kBool));
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0], (std::vector<std::int64_t>{0, 1, 2}));
}

TEST(Extent, IsThatOfAPlateInAnyDirection) {
  const auto grid = torch::meshgrid({torch::arange(40) * 0.01, torch::arange(20) * 0.01}, "ij");
  const torch::Tensor flat = torch::stack({grid[0], grid[1], torch::zeros_like(grid[0])}, 2);
  const double c = std::cos(0.7);
  const double s = std::sin(0.7);
  const torch::Tensor R =
      torch::tensor({{c, -s, 0.0}, {0.6 * s, 0.6 * c, -0.8}, {0.8 * s, 0.8 * c, 0.6}});
  const Extent extent =
      extent_of(flat.view({-1, 3}).to(torch::kFloat64).mm(R.t().to(torch::kFloat64)), 0.01);
  EXPECT_NEAR(extent.length_m, 0.4, 1e-3);
  EXPECT_NEAR(extent.width_m, 0.2, 1e-3);
  EXPECT_NEAR(extent.area_m2, 0.08, 0.004);
}

TEST(CellKeys, StepsMoveByWholeCells) {
  const torch::Tensor p = torch::tensor({{-3.2, 0.4, 7.9}}, torch::kFloat64);
  const torch::Tensor moved = p + torch::tensor({{2.0, -1.0, 3.0}}, torch::kFloat64);
  EXPECT_TRUE(torch::equal(cell_keys(moved, 1.0), cell_keys(p, 1.0) + key_step(2, -1, 3)));
}

}  // namespace
}  // namespace apvi::change
