// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "change/change_map.hpp"
#include "change/color_comparison.hpp"
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
  ColorComparison colors{};
};

/// The changes that consist of cells of the surface that the other session's views see through, at
/// least `min_size_m` long. Where both maps look alike from the same views, only a surface is
/// wrong: that is left out.
std::vector<Change> relief_changes(const Surface& surface, Kind kind, double min_size_m);

/// The changes among the cells `rows` [m] of a surface that look different in the other session, by
/// these residuals: farther than four standard deviations from the noise and by at least a fifth in
/// a channel. Another thing that stands out from the other surface by two standard deviations is of
/// kind `standing_out`, everything else a color. Where the same thing is only brighter or darker,
/// there is sun or shade: that is left out.
std::vector<Change> look_changes(const Surface& surface, double other_black, Kind standing_out,
                                 const torch::Tensor& rows, const ColorResiduals& colors,
                                 double min_size_m);

void append(std::vector<Change>& changes, std::vector<Change> more);

/// Appends changes of color, but those that are at one that has appeared or vanished: they are the
/// same, or its rim.
void append_color_changes(std::vector<Change>& changes, std::vector<Change> more,
                          double min_size_m);

/// Orders the changes by kind and size, and pairs what vanished with what appeared in its size and
/// color elsewhere.
void finish(std::vector<Change>& changes);

}  // namespace apvi::change
