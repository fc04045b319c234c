// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "apvi/mapping/keyframe_store.hpp"
#include "apvi/splat/gaussians.hpp"

namespace apvi::bridge {

/// A map, its keyframes and their poses in formats of other programs. All write below `folder`,
/// which is made; they throw RunError when something cannot be written.

/// COLMAP's text model: sparse/0/{cameras,images,points3D}.txt (one PINHOLE camera; the centres of
/// the Gaussians as points, without tracks) and images/*.png.
void export_colmap(const std::filesystem::path& folder, const mapping::KeyframeStore& keyframes,
                   const splat::Gaussians& map);

/// Nerfstudio's transforms.json (camera to world, OpenGL axes: x right, y up, z back) with
/// images/*.png and points.ply, which it starts from.
void export_nerfstudio(const std::filesystem::path& folder, const mapping::KeyframeStore& keyframes,
                       const splat::Gaussians& map);

/// A finished run of the mapping half.
struct FinishedRun {
  std::filesystem::path map;         ///< map.ply
  mapping::KeyframeStore keyframes;  ///< with their poses as the run left them
};
/// Reads the keyframes of a run folder again, from the recording that its resolved.yaml names.
/// Throws InputError when the folder is no such run.
FinishedRun open_run(const std::filesystem::path& folder);

}  // namespace apvi::bridge
