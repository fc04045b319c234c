// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "change/session.hpp"
#include "change/surface_cells.hpp"

namespace apvi::change {

/// The colors of n cells in both sessions: both maps are drawn from the same views, those of the
/// session that the cells belong to. An error of a surface moves what is seen there little, while
/// it would put colors of one map next to the wrong ones of the other.
struct ColorComparison {
  torch::Tensor own;    ///< [n,3] mean logarithm of the light in the cells' own map
  torch::Tensor other;  ///< [n,3] in the other map
  torch::Tensor views;  ///< [n] number of views that show the cell, and something in the other map
  /// [n] brightness of both relative to its mean within two cells: what is seen, in whatever light.
  torch::Tensor own_detail, other_detail;
};

/// The map of the other session.
struct OtherMap {
  const mapping::Map& map;
  double black = 0.0;  ///< see `view_light`
  /// Its frame from that of the cells [4,4], as it is near a point of the cells.
  std::function<torch::Tensor(const Eigen::Vector3d&)> motion_at;
};
ColorComparison compare_colors(const SurfaceCells& cells, const std::vector<SurfaceView>& views,
                               const OtherMap& other, const std::function<void(double)>& progress);

/// Correlation of the details of cells in the two sessions, -1 to 1: large where the same thing
/// is seen, though perhaps in other light; about zero where there is another one.
double correlation(const ColorComparison& colors, const torch::Tensor& rows);

}  // namespace apvi::change
