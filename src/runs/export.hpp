// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "gaussians/model/gaussians.hpp"
#include "mapping/keyframes/keyframe_store.hpp"

namespace apvi::runs {

/// Exports a map, its keyframes and their poses to the formats of other programs, into `folder`,
/// which is created. Throws RunError when something cannot be written.

/// COLMAP's text model: sparse/0/{cameras,images,points3D}.txt (one PINHOLE camera; the centers of
/// the Gaussians as points, without tracks) and images/*.png.
void export_colmap(const std::filesystem::path& folder, const mapping::KeyframeStore& keyframes,
                   const gaussians::Gaussians& map);

/// Nerfstudio's transforms.json (camera to world, OpenGL axes: x right, y up, z back) with
/// images/*.png and points.ply, which it starts from.
void export_nerfstudio(const std::filesystem::path& folder, const mapping::KeyframeStore& keyframes,
                       const gaussians::Gaussians& map);

/// A finished mapping run.
struct FinishedRun {
  std::filesystem::path map;         ///< map.ply
  mapping::KeyframeStore keyframes;  ///< with their final poses
};
/// Loads the keyframes of a run folder from the recording named in its resolved.yaml. Throws
/// InputError when the folder is not a mapping run.
FinishedRun load_finished_run(const std::filesystem::path& folder);

}  // namespace apvi::runs
