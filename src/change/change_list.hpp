// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "change/change_map.hpp"
#include "change/color_residuals.hpp"
#include "change/surface_cells.hpp"
#include "change/votes.hpp"

namespace apvi::change {

/// The surface of a session, and what the other one says about it.
struct Surface {
  std::vector<SurfaceView> views;
  double black = 0.0;  ///< see `surface_view`
  SurfaceCells cells;
  torch::Tensor moved{};  ///< [n,3] the points in the frame of the earlier session [m]
  Votes votes{};
};

/// The changes that consist of cells of the surface that the other session's views see through, at
/// least `min_size_m` long.
std::vector<Change> relief_changes(const Surface& surface, Kind kind, double min_size_m);

/// The changes of color among the cells `rows` [m] of the later surface with these residuals:
/// farther than four standard deviations from the noise and by at least a fifth in a channel.
std::vector<Change> color_changes(const Surface& before, const Surface& after,
                                  const torch::Tensor& rows, const ColorResiduals& colors,
                                  double min_size_m);

void append(std::vector<Change>& changes, std::vector<Change> more);

/// Leaves out colors at the rim of something that appeared or vanished, orders the changes by kind
/// and size, and pairs what vanished with what appeared in its size and color elsewhere.
void finish(std::vector<Change>& changes, double min_size_m);

}  // namespace apvi::change
