// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "map_io/map_file.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::runs {

/// Exports a map, its keyframes and their poses to the formats of other programs, into `folder`,
/// which is created. Positions are relative to the map's local origin, since most readers have
/// float32 only; origin.json has the origin if it is not zero. Throws RunError when something
/// cannot be written.

/// COLMAP's text model: sparse/0/{cameras,images,points3D}.txt (one PINHOLE camera; the centers of
/// the Gaussians as points, without tracks) and images/*.png.
void export_colmap(const std::filesystem::path& folder, const mapping::KeyframeStore& keyframes,
                   const map_io::MapFile& map);

/// Nerfstudio's transforms.json (camera to world, OpenGL axes: x right, y up, z back) with
/// images/*.png and points.ply, which it starts from.
void export_nerfstudio(const std::filesystem::path& folder, const mapping::KeyframeStore& keyframes,
                       const map_io::MapFile& map);

/// A finished mapping run.
struct FinishedRun {
  map_io::MapFile map;
  mapping::KeyframeStore keyframes;  ///< with their final poses, relative to the map's origin
};
/// Loads the map of a run folder, and its keyframes from the recording named in its resolved.yaml.
/// Throws InputError when the folder is not a mapping run.
FinishedRun load_finished_run(const std::filesystem::path& folder);
/// The map of a run folder or of a map file. Throws InputError.
map_io::MapFile load_map(const std::filesystem::path& source);

}  // namespace apvi::runs
