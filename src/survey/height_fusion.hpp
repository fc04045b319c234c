// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <vector>

#include "survey/survey_map.hpp"
#include "survey/survey_view.hpp"

namespace apvi::survey {

/// Heights by the depth of the map in its views (`reliable_depth`), which the images constrained,
/// instead of from above, where no camera was.
///
/// Fixed-point iteration on every vertical line: a view whose ray through the point at height z
/// meets the surface at depth d instead of the point's depth d_p puts a level surface at
/// z - (d - d_p) (z_camera - z) / d_p. Views that see the point occluded (the surface nearer by
/// more than a truncation) are left out, larger distances are truncated, and the mean over the
/// views is the next height, as in a truncated signed distance function (Curless and Levoy, 1996).
/// The truncation falls from 25 % to 2.5 % of the camera's height above the point.
class HeightFusion {
 public:
  /// `map` with all of its Gaussians. Views wider than 640 px are reduced.
  HeightFusion(const SurveyMap& map, std::vector<SurveyView> views);

  /// Heights [H,W] float64 [m], NaN where unknown, refined; NaN also where fewer than three views
  /// (or all, if there are fewer) agree within the last truncation or see the surface farther away.
  /// Holds the depth images of the views that see the tile, 256 MiB at most of them, evenly spread.
  torch::Tensor operator()(const torch::Tensor& heights, const GroundGrid& tile) const;

 private:
  const SurveyMap* map_;
  std::vector<SurveyView> views_;
};

}  // namespace apvi::survey
