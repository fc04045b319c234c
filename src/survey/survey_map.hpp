// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "apvi/geometry/se3.hpp"
#include "mapping/rendering.hpp"
#include "survey/ground_grid.hpp"

namespace apvi::survey {

/// A map and its place on the ground.
struct SurveyMap {
  mapping::Map map;
  SE3 T_crs_map;  ///< from the map's local frame to easting, northing, height [m]
};

/// Bounds of the Gaussians with an opacity of at least 0.5 by their centers, without outliers: at
/// most a tenth of the central 99 % of them is added on each side. Throws InputError for a map
/// without such Gaussians.
GroundBounds bounds_of(const SurveyMap& map);

}  // namespace apvi::survey
