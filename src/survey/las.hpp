// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <torch/types.h>

#include <filesystem>

#include "survey/color_rule.hpp"
#include "survey/georeference.hpp"
#include "survey/survey_map.hpp"

namespace apvi::survey {

/// Points of a surface in a coordinate reference system.
struct SurfacePoints {
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();  ///< easting, northing, height [m]
  torch::Tensor positions;  ///< [n,3] float64: minus the anchor [m], on the CPU
  torch::Tensor colors;     ///< [n,3] float32 in [0, 1]
};

/// Centers of the Gaussians with an opacity of at least 0.5 within `bounds_of(map)`, with their
/// colors seen from above.
SurfacePoints surface_points(const SurveyMap& map, const ColorRule& colors);

/// Writes a LAS 1.4 file (ASPRS, R15): point format 7 with 16-bit colors, coordinates in steps of
/// 0.1 mm, unclassified, the coordinate reference system as WKT. Throws RunError when it cannot be
/// written, InputError for points that are more than 200 km apart.
void write_las(const std::filesystem::path& file, const SurfacePoints& points,
               const Georeference& reference);

}  // namespace apvi::survey
