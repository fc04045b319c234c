// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "change/surface_cells.hpp"

namespace apvi::change {

/// What the views of the other session say about n cells, each [n] float32.
struct Votes {
  torch::Tensor through;   ///< views that see through the cell to a surface behind it
  torch::Tensor weak;      ///< the same at half the tolerance
  torch::Tensor near;      ///< views whose surface is the same within the tolerance
  torch::Tensor relief;    ///< mean distance in front of their surface, within 0.3 m of it [m]
  torch::Tensor noise;     ///< its standard deviation [m]; zero where no view tells
  torch::Tensor distance;  ///< the same over those that see through, at any distance [m]
  double enough = 3.0;     ///< number of views that can decide, see `enough_views`

  /// Cells [n] that enough views have decided about.
  torch::Tensor decided() const;
  /// Cells that are not in the other session: three of four deciding views see through.
  torch::Tensor changed() const;
  torch::Tensor nearly_changed() const;
};

/// The number of views that it takes to decide about a cell: a third of the median over the cells
/// that any view decides about, at least 3 and at most 8. Where a dive has many views of most
/// places, those with few are at its border and have the worst surfaces.
double enough_views(const Votes& votes);

/// Lets the views vote on cells whose points are given in the frame of the views. Surfaces are the
/// same within the largest of `least_m`, the `sigma` of both, and four standard deviations of the
/// mean distances between the surfaces: in the neighborhood, 3 m wide, and of cells with as many
/// views. Views whose surface is in front of a cell do not decide.
Votes vote(const SurfaceCells& cells, const torch::Tensor& points,
           const std::vector<SurfaceView>& views, double least_m);

}  // namespace apvi::change
