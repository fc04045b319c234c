// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/render/view.hpp"
#include "gaussians/render/view_cone.hpp"

namespace apvi::gaussians {

/// A map in levels of detail, to draw what is far away with fewer Gaussians.
///
/// Level 0 are the Gaussians themselves. In level k those within one cell of a cubic grid are
/// merged; its cells are twice as large as those of level k - 1. Gaussians larger than a cell are
/// not merged there. Blocks of 64^3 of the smallest cells are drawn in one level each, or not at
/// all when they are outside of the view.
class DetailLevels {
 public:
  /// Shares the tensors of the map, and adds about half as much. Gaussians that are not finite are
  /// left out.
  explicit DetailLevels(const Gaussians& gaussians);

  /// The Gaussians to draw from a view: of each block in it, the coarsest level whose cells are at
  /// most `max_cell_px` wide in the image; 0: the finest.
  Gaussians select(const View& view, double max_cell_px) const;

  /// The finest level of at most so many Gaussians, or the coarsest.
  Gaussians at_most(std::int64_t count) const;

  /// Gaussians of each level, from the finest to the coarsest.
  std::vector<std::int64_t> sizes() const;

 private:
  struct Level {
    Gaussians gaussians;
    std::vector<std::int64_t> rows;    ///< by block; empty: they are ordered by block themselves
    std::vector<std::int64_t> begins;  ///< of each block, then the end
  };
  struct Block {
    Sphere means;          ///< around the means, in the world
    double reach_m = 0.0;  ///< of the largest Gaussian
  };

  void set_blocks(const Gaussians& ordered);
  std::size_t level_for(const Intrinsics& camera, const Sphere& in_camera,
                        double max_cell_px) const;

  std::vector<Level> levels_;
  std::vector<Block> blocks_;
  double cell_m_ = 0.0;  ///< width of the cells of level 0
};

}  // namespace apvi::gaussians
