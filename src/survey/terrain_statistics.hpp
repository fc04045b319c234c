// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <limits>

namespace apvi::survey {

/// Shape of the ground, from the cells of an elevation model: a cell lies between four neighboring
/// pixels whose heights are all known.
class TerrainStatistics {
 public:
  explicit TerrainStatistics(double resolution_m) : resolution_m_(resolution_m) {}

  /// Adds the cells of heights [H,W], NaN where unknown. Tiles must overlap by one pixel.
  void add(const torch::Tensor& elevation);

  std::int64_t cells() const { return cells_; }
  /// Area as seen from above [m²].
  double planar_area_m2() const;
  /// Area of the two triangles of each cell [m²].
  double surface_area_m2() const { return surface_area_m2_; }
  /// Rugosity: surface area by planar area (Jenness, 2004), at least 1; NaN without cells.
  double rugosity() const { return surface_area_m2_ / planar_area_m2(); }
  /// Mean over the cells of the angle between the ground and the horizontal [deg], from central
  /// differences over a cell; NaN without cells.
  double mean_slope_deg() const { return slope_sum_deg_ / static_cast<double>(cells_); }
  /// Heights of the pixels of cells [m]; infinite without cells.
  double lowest_m() const { return lowest_m_; }
  double highest_m() const { return highest_m_; }
  /// Volume between the ground and the horizontal plane through its lowest pixel [m³]: the mean
  /// height of the corners of each cell above it, times the area of the cell.
  double volume_above_lowest_m3() const;

 private:
  double resolution_m_;
  std::int64_t cells_ = 0;
  double surface_area_m2_ = 0.0;
  double slope_sum_deg_ = 0.0;
  double height_sum_m_ = 0.0;  ///< of the cells
  double lowest_m_ = std::numeric_limits<double>::infinity();
  double highest_m_ = -std::numeric_limits<double>::infinity();
};

}  // namespace apvi::survey
