// SPDX-License-Identifier: BSD-3-Clause
#include "survey/ground_grid.hpp"

#include <algorithm>
#include <cmath>

#include "apvi/core/error.hpp"

namespace apvi::survey {
namespace {

constexpr double kMaxPixels = 2147483648.0;
constexpr double kTolerance = 1e-6;  // [px]: an edge that is a multiple but for rounding

}  // namespace

GroundGrid grid_around(const GroundBounds& bounds, double resolution_m) {
  if (!(resolution_m > 0.0)) fail_input("--resolution: {} m; must be positive", resolution_m);
  const double left = std::floor(bounds.west / resolution_m + kTolerance);
  const double right = std::ceil(bounds.east / resolution_m - kTolerance);
  const double bottom = std::floor(bounds.south / resolution_m + kTolerance);
  const double top = std::ceil(bounds.north / resolution_m - kTolerance);
  const double width = std::max(1.0, right - left);
  const double height = std::max(1.0, top - bottom);
  if (!(width * height <= kMaxPixels)) {
    fail_input("--resolution: {:.4g} m makes {:.0f} x {:.0f} pixels; give a larger one",
               resolution_m, width, height);
  }
  return {left * resolution_m, top * resolution_m, resolution_m, static_cast<std::int64_t>(width),
          static_cast<std::int64_t>(height)};
}

std::vector<GroundTile> tiles_of(const GroundGrid& grid, std::int64_t side) {
  std::vector<GroundTile> tiles;
  for (std::int64_t row = 0; row < grid.height; row += side) {
    for (std::int64_t column = 0; column < grid.width; column += side) {
      const double x = static_cast<double>(column) * grid.resolution_m;
      const double y = static_cast<double>(row) * grid.resolution_m;
      tiles.push_back({column,
                       row,
                       {grid.west + x, grid.north - y, grid.resolution_m,
                        std::min(side, grid.width - column), std::min(side, grid.height - row)}});
    }
  }
  return tiles;
}

}  // namespace apvi::survey
