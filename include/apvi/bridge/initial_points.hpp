// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "apvi/bridge/run_config.hpp"
#include "apvi/mapping/initial_map.hpp"
#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/splat/ply.hpp"

namespace apvi::bridge {

/// The points a map begins with, as `mapping.initial_points` says. Only training images are looked
/// at. Throws InputError when a file is bad, or when no point can be triangulated.
splat::PointCloud initial_points(const RunConfig& config, const mapping::KeyframeStore& store);

/// Reads COLMAP's points3D.txt (POINT3D_ID X Y Z R G B ERROR TRACK…). Throws InputError with file
/// and line.
splat::PointCloud read_colmap_points(const std::filesystem::path& path);

/// The box around the cameras, grown on every side by `margin` of its diagonal (at least 1 m).
mapping::Box camera_box(const mapping::KeyframeStore& store, double margin);

/// Points matched between neighbouring training images (of more than 400, so many, evenly) by SIFT
/// (Lowe, 2004) and triangulated with the given poses; those that do not reproject within 2 px, or
/// were seen under less than 1.5 degrees, are left out.
splat::PointCloud triangulate_points(const mapping::KeyframeStore& store);

}  // namespace apvi::bridge
