// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "change/surface_view.hpp"

namespace apvi::change {

/// The surface of a map in the cells of a sparse grid of cubes, ordered by key; n cells.
struct SurfaceCells {
  double cell_m = 0.0;
  torch::Tensor keys;     ///< [n] int64, see `cell_keys`
  torch::Tensor points;   ///< [n,3] mean surface in the cell, in the world [m]
  torch::Tensor normals;  ///< [n,3] unit, toward the cameras
  torch::Tensor color;    ///< [n,3] mean logarithm of the light
  torch::Tensor detail;   ///< [n,2] mean details of the brightness
  torch::Tensor sigma;    ///< [n] between views and along their rays, along the normal [m]
  torch::Tensor views;    ///< [n] int64: views that show the surface here

  std::int64_t size() const { return keys.size(0); }
};

/// Keys [n] int64 of the cells of points [n,3]: 21 bits for each index, x in the highest ones.
torch::Tensor cell_keys(const torch::Tensor& points, double cell_m);
/// What to add to a key to move by whole cells.
std::int64_t key_step(std::int64_t x, std::int64_t y, std::int64_t z);
/// Rows [n] int64 of `wanted` in the ascending `keys`; -1 where there is none.
torch::Tensor rows_of(const torch::Tensor& keys, const torch::Tensor& wanted);

/// Means [n,k] of values [n,k] over the cells with these keys [n] in the cube of cells that reaches
/// `reach` cells to every side.
torch::Tensor averaged_over_cells(const torch::Tensor& keys, const torch::Tensor& values,
                                  std::int64_t reach);

/// Gathers the surface of all views in cells, keeps those on which at least three views agree (or
/// all, if there are fewer), and more than twice as many as see through them, and moves the points
/// to the mean surface. Views agree with a cell within three robust standard deviations of all
/// distances. Fills `sigma` of the views by that of the cells, and removes from the views what is
/// in no cell: floating Gaussians and other surfaces that the views contradict.
SurfaceCells surface_cells(std::vector<SurfaceView>& views, double cell_m);

}  // namespace apvi::change
