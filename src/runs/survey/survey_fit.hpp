// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "apvi/geometry/trajectory.hpp"
#include "survey/georeference.hpp"

namespace apvi::runs {

/// A georeference by positions, with its residuals.
struct FittedGeoreference {
  survey::Georeference reference;
  double heading_deg = 0.0;       ///< of the recording's x axis, clockwise from grid north
  std::size_t fixes = 0;          ///< used, within the trajectory
  double horizontal_rms_m = 0.0;  ///< of the residuals
  double horizontal_max_m = 0.0;
};

/// Fits heading and translation of a trajectory to positions in a coordinate reference system:
/// least squares with a rotation about the vertical only (Umeyama, 1991), at the stamps of the
/// positions. Positions without heights, as of GNSS at the surface, leave heights as they are. The
/// lever arm of the antenna is not applied. Throws InputError for fewer than two distinct positions
/// within the trajectory.
FittedGeoreference fit_georeference(const Trajectory& trajectory, const Trajectory& positions,
                                    const std::optional<int>& epsg, bool z_down);

}  // namespace apvi::runs
