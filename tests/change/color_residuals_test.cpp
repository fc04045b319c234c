// SPDX-License-Identifier: BSD-3-Clause
#include "change/color_residuals.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include "change/surface_cells.hpp"
#include "change/two_dives.hpp"

namespace apvi::change {
namespace {

constexpr double kCell_m = 0.025;

/// A floor of 3 x 3 m in two sessions: log after = 1.2 log before + (0.3, -0.2, 0.1) + noise.
ColorPairs floor_pairs() {
  torch::manual_seed(11);
  const torch::Tensor points = test::lattice({0.0, 0.0, 0.01}, 2, 1.5, 1.5, kCell_m);
  const torch::Tensor keys = cell_keys(points, kCell_m);
  const torch::Tensor order = keys.argsort();
  const torch::Tensor before = 0.4 * torch::randn({points.size(0), 3}) - 1.0;
  const torch::Tensor after =
      1.2 * before + torch::tensor({0.3F, -0.2F, 0.1F}) + 0.05 * torch::randn({points.size(0), 3});
  return {keys.index_select(0, order), points.index_select(0, order).to(torch::kFloat32), before,
          after, torch::full({points.size(0)}, 5.0F)};
}

TEST(ColorResiduals, TheLineBetweenTheSessionsIsFound) {
  const ColorResiduals found = color_residuals(floor_pairs(), kCell_m, 0.025);
  const std::vector<double> offsets = {0.3, -0.2, 0.1};
  for (std::int64_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(found.slope[i].item<double>(), 1.2, 0.02);
    EXPECT_NEAR(found.offset[i].item<double>(), offsets[static_cast<std::size_t>(i)], 0.02);
  }
}

TEST(ColorResiduals, NoiseIsWithinItsOwnDeviation) {
  const ColorResiduals found = color_residuals(floor_pairs(), kCell_m, 0.025);
  const double outside = (found.distance > 4.0).to(torch::kFloat64).mean().item<double>();
  EXPECT_LT(outside, 0.005);
}

TEST(ColorResiduals, APartOfTheFloorThatChangesStandsOut) {
  ColorPairs pairs = floor_pairs();
  const torch::Tensor disc = pairs.points.norm(2, 1) < 0.35;
  pairs.after.select(1, 0) += 0.5 * disc.to(torch::kFloat32);
  const ColorResiduals found = color_residuals(pairs, kCell_m, 0.025);
  const torch::Tensor inner = pairs.points.norm(2, 1) < 0.3;
  EXPECT_GT(found.distance.index({inner}).min().item<double>(), 4.0);
  EXPECT_NEAR(found.residual.select(1, 0).index({inner}).mean().item<double>(), 0.5, 0.05);
}

TEST(ColorResiduals, LightThatFadesAcrossTheFloorIsTakenOut) {
  ColorPairs pairs = floor_pairs();
  pairs.after += 0.05 * pairs.points.slice(1, 0, 1);
  const ColorResiduals found = color_residuals(pairs, kCell_m, 0.025);
  EXPECT_LT(found.residual.abs().mean().item<double>(), 0.03);
  EXPECT_LT((found.distance > 4.0).to(torch::kFloat64).mean().item<double>(), 0.005);
}

}  // namespace
}  // namespace apvi::change
