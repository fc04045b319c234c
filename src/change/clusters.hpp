// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

namespace apvi::change {

/// Connected components of the cells that are `strong` [n], over gaps of one cell, with the `weak`
/// [n] cells that touch them. `keys` [n] as of `cell_keys`. Rows of the cells of each component,
/// ascending, in the order of their first cell.
std::vector<std::vector<std::int64_t>> clusters(const torch::Tensor& keys,
                                                const torch::Tensor& strong,
                                                const torch::Tensor& weak);

/// Extent of points [n,3] of a cluster.
struct Extent {
  double length_m = 0.0;  ///< the larger one along the first two principal axes, with a cell
  double width_m = 0.0;   ///< the smaller one
  double area_m2 = 0.0;   ///< of the cells, seen along the shortest one
};
Extent extent_of(const torch::Tensor& points, double cell_m);

}  // namespace apvi::change
