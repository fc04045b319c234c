// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

namespace apvi::survey {

/// Rectangle on the ground, in easting and northing [m].
struct GroundBounds {
  double west = 0.0;
  double south = 0.0;
  double east = 0.0;
  double north = 0.0;
};

/// Square pixels on the ground. Rows go from north to south; `west` and `north` are the outer edges
/// of pixel (0, 0).
struct GroundGrid {
  double west = 0.0;   ///< easting [m]
  double north = 0.0;  ///< northing [m]
  double resolution_m = 0.0;
  std::int64_t width = 0;  ///< [px]
  std::int64_t height = 0;

  double east() const { return west + static_cast<double>(width) * resolution_m; }
  double south() const { return north - static_cast<double>(height) * resolution_m; }
};

/// The smallest grid around `bounds` whose edges are multiples of the resolution, so that products
/// of the same resolution have common pixels. Throws InputError when it has more than 2^31 pixels.
GroundGrid grid_around(const GroundBounds& bounds, double resolution_m);

/// A part of a grid.
struct GroundTile {
  std::int64_t column = 0;  ///< of its first pixel in the whole grid
  std::int64_t row = 0;
  GroundGrid grid;
};
/// The tiles of `side` x `side` px that cover a grid, row by row; the last ones may be smaller.
std::vector<GroundTile> tiles_of(const GroundGrid& grid, std::int64_t side);

}  // namespace apvi::survey
