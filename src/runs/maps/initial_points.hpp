// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "map_io/ply.hpp"
#include "mapping/density/initial_map.hpp"
#include "mapping/keyframes/keyframe_store.hpp"
#include "runs/run_config.hpp"

namespace apvi::runs {

/// Initial points of a map as configured by `mapping.initial_points`, from training images only,
/// relative to the local origin of the map. Files and `mapping.initial_box_m` are in the
/// coordinates of the recording's poses.
/// Throws InputError when a file is invalid or no point can be triangulated.
gaussians::PointCloud initial_points(const RunConfig& config, const mapping::KeyframeStore& store,
                                     const map_io::Origin& origin = {});

/// Reads COLMAP's points3D.txt (POINT3D_ID X Y Z R G B ERROR TRACK…), relative to `origin`. Throws
/// InputError with file and line.
gaussians::PointCloud read_colmap_points(const std::filesystem::path& path,
                                         const map_io::Origin& origin = {});

/// Bounding box of the cameras, extended on every side by `margin` times its diagonal (at least
/// 1 m).
mapping::Box camera_box(const mapping::KeyframeStore& store, double margin);

/// Points matched between neighboring training images (at most 400, evenly spaced) with SIFT (Lowe,
/// 2004) and triangulated with the given poses; points with a reprojection error above 2 px or a
/// parallax below 1.5 degrees are discarded.
gaussians::PointCloud triangulate_points(const mapping::KeyframeStore& store);

}  // namespace apvi::runs
