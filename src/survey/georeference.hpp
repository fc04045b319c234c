// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "apvi/geometry/se3.hpp"

namespace apvi::survey {

/// Where the coordinates of a recording lie in a coordinate reference system.
struct GeoreferenceOptions {
  std::optional<int> epsg{};  ///< code of a projected system in meters; empty: a local system
  /// Easting, northing and height of the recording's origin [m].
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  /// Direction of the recording's x axis, clockwise from grid north [deg]. Empty: 90 (x is east)
  /// with z up, 0 (x is north) with z down.
  std::optional<double> heading_deg{};
};

/// A coordinate reference system (easting, northing, height) and the place of a recording in it.
struct Georeference {
  std::optional<int> epsg{};  ///< empty: a local engineering system
  SE3 T_crs_world;            ///< from the recording's coordinates to the system [m]
};

/// `z_down`: the recording's world is north-east-down or another one with z down. With z up and
/// heading h, E = E0 + x sin h - y cos h and N = N0 + x cos h + y sin h.
Georeference georeference(const GeoreferenceOptions& options, bool z_down);

/// The system as well-known text (WKT 1); of an EPSG code only in a build with GDAL. Throws
/// InputError for an unknown code, and for a system that is not projected or not in meters.
std::string well_known_text(const std::optional<int>& epsg);

}  // namespace apvi::survey
