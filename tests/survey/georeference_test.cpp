// SPDX-License-Identifier: BSD-3-Clause
#include "survey/georeference.hpp"

#include <gtest/gtest.h>

#include "apvi/core/error.hpp"
#include "survey/ground_grid.hpp"

namespace apvi::survey {
namespace {

using Eigen::Vector3d;

void expect_near(const Vector3d& a, const Vector3d& b) {
  EXPECT_LT((a - b).norm(), 1e-9) << a.transpose() << " instead of " << b.transpose();
}

TEST(Georeference, WithoutOptionsCoordinatesStayAsTheyAre) {
  const SE3 T = georeference({}, false).T_crs_world;
  expect_near(T * Vector3d(1.0, 2.0, 3.0), {1.0, 2.0, 3.0});
}

TEST(Georeference, NorthEastDownBecomesEastNorthUp) {
  const SE3 T = georeference({}, true).T_crs_world;
  expect_near(T * Vector3d(1.0, 2.0, 3.0), {2.0, 1.0, -3.0});
}

TEST(Georeference, HeadingTurnsTheXAxisClockwiseFromNorth) {
  const Vector3d origin(500000.0, 5000000.0, 10.0);
  const SE3 north = georeference({32632, origin, 0.0}, false).T_crs_world;
  expect_near(north * Vector3d(1.0, 0.0, 2.0), origin + Vector3d(0.0, 1.0, 2.0));
  expect_near(north * Vector3d(0.0, 1.0, 0.0), origin + Vector3d(-1.0, 0.0, 0.0));
  const SE3 south = georeference({32632, origin, 180.0}, false).T_crs_world;
  expect_near(south * Vector3d(1.0, 0.0, 0.0), origin + Vector3d(0.0, -1.0, 0.0));
  const SE3 down = georeference({32632, origin, 90.0}, true).T_crs_world;
  expect_near(down * Vector3d(1.0, 0.0, 0.0), origin + Vector3d(1.0, 0.0, 0.0));
  expect_near(down * Vector3d(0.0, 1.0, 0.0), origin + Vector3d(0.0, -1.0, 0.0));
}

TEST(Georeference, TheLocalSystemNeedsNoLibrary) {
  EXPECT_EQ(well_known_text(std::nullopt).substr(0, 9), "LOCAL_CS[");
}

TEST(GroundGrid, EdgesAreMultiplesOfTheResolution) {
  const GroundGrid grid = grid_around({-1.03, 2.0, 1.0, 3.999}, 0.05);
  EXPECT_NEAR(grid.west, -1.05, 1e-12);
  EXPECT_NEAR(grid.north, 4.0, 1e-12);
  EXPECT_EQ(grid.width, 41);
  EXPECT_EQ(grid.height, 40);
  EXPECT_NEAR(grid.east(), 1.0, 1e-12);
  EXPECT_NEAR(grid.south(), 2.0, 1e-12);
}

TEST(GroundGrid, TilesCoverItOnce) {
  const GroundGrid grid = grid_around({0.0, 0.0, 10.0, 7.0}, 0.1);
  std::int64_t pixels = 0;
  for (const GroundTile& tile : tiles_of(grid, 32)) {
    pixels += tile.grid.width * tile.grid.height;
    EXPECT_NEAR(tile.grid.west, 0.1 * static_cast<double>(tile.column), 1e-9);
    EXPECT_NEAR(tile.grid.north, 7.0 - 0.1 * static_cast<double>(tile.row), 1e-9);
  }
  EXPECT_EQ(pixels, grid.width * grid.height);
}

TEST(GroundGrid, TooManyPixelsAreRefusedWithTheirNumber) {
  try {
    grid_around({0.0, 0.0, 1e5, 1e5}, 0.001);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("100000000 x 100000000 pixels"), std::string::npos);
  }
}

}  // namespace
}  // namespace apvi::survey
