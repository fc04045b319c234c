// SPDX-License-Identifier: BSD-3-Clause
#include "survey/terrain_statistics.hpp"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace apvi::survey {
namespace {

using torch::Tensor;

constexpr double kResolution_m = 0.1;

/// x of 101 x 101 pixels over 10 m x 10 m.
Tensor x_of_pixels() {
  return (torch::arange(101, torch::kFloat64) * kResolution_m).expand({101, 101});
}

TEST(TerrainStatistics, OfASlopeAreThoseOfItsPlane) {
  TerrainStatistics terrain(kResolution_m);
  terrain.add(-7.0 + 0.5 * x_of_pixels());
  EXPECT_NEAR(terrain.planar_area_m2(), 100.0, 1e-9);
  EXPECT_NEAR(terrain.rugosity(), std::sqrt(1.25), 1e-9);
  EXPECT_NEAR(terrain.mean_slope_deg(), std::atan(0.5) * 180.0 / std::numbers::pi, 1e-9);
  EXPECT_NEAR(terrain.lowest_m(), -7.0, 1e-12);
  EXPECT_NEAR(terrain.highest_m(), -2.0, 1e-12);
  EXPECT_NEAR(terrain.volume_above_lowest_m3(), 0.5 * 5.0 * 100.0, 1e-9);
}

TEST(TerrainStatistics, OfASphericalCapAreThoseOfItsFormulas) {
  const double radius = 4.0;
  const double rim = 0.8 * radius;  // of the cap
  const double cap = 0.4 * radius;  // its height
  TerrainStatistics terrain(0.02);
  const Tensor line = (torch::arange(501, torch::kFloat64) - 250.0) * 0.02;
  const Tensor square = line.square() + line.square().unsqueeze(1);
  terrain.add((radius * radius - square)
                  .clamp_min(0.0)
                  .sqrt()
                  .masked_fill(square > rim * rim, std::numeric_limits<double>::quiet_NaN()));
  EXPECT_NEAR(terrain.planar_area_m2() / (std::numbers::pi * rim * rim), 1.0, 0.02);
  EXPECT_NEAR(terrain.rugosity(), 2.0 * radius * cap / (rim * rim), 0.01);
  const double volume = std::numbers::pi * cap * cap * (3.0 * radius - cap) / 3.0;
  EXPECT_NEAR(terrain.volume_above_lowest_m3() / volume, 1.0, 0.02);
}

TEST(TerrainStatistics, TilesWithAnOverlapEqualTheWhole) {
  const Tensor z = (3.0 * x_of_pixels()).sin() + 0.2 * x_of_pixels().t();
  TerrainStatistics whole(kResolution_m);
  whole.add(z);
  TerrainStatistics tiles(kResolution_m);
  tiles.add(z.slice(1, 0, 41));
  tiles.add(z.slice(1, 40));
  EXPECT_EQ(tiles.cells(), whole.cells());
  EXPECT_NEAR(tiles.surface_area_m2(), whole.surface_area_m2(), 1e-9);
  EXPECT_NEAR(tiles.volume_above_lowest_m3(), whole.volume_above_lowest_m3(), 1e-9);
}

TEST(TerrainStatistics, CellsWithAnUnknownPixelDoNotCount) {
  Tensor z = x_of_pixels().clone();
  z[50][50] = std::numeric_limits<double>::quiet_NaN();
  TerrainStatistics terrain(kResolution_m);
  terrain.add(z);
  EXPECT_EQ(terrain.cells(), 100 * 100 - 4);
}

}  // namespace
}  // namespace apvi::survey
