// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>

#include "apvi/splat/view.hpp"

namespace apvi::bridge {

struct RenderRequest {
  std::filesystem::path source;    ///< run folder or .ply file
  std::filesystem::path path{};    ///< to render along: of the run's body, or of the camera
  std::filesystem::path camera{};  ///< camera.json: one view, or the lens for `path`
  std::filesystem::path out;       ///< folder
  bool restore = false;            ///< also without water
  bool depth = false;              ///< also depth
  bool as_float = false;           ///< PFM instead of PNG
};

/// Draws a map along a path or from one camera into `out`; a run folder without either along its
/// keyframes. Files are named by stamp [ns], or by the map's file for one camera: NAME.png as seen,
/// NAME_restored.png without water, NAME_depth.png (16 bit, millimetres); with `as_float` .pfm
/// (depth in metres). Returns the number of views. Throws InputError for what cannot be used.
std::size_t render_run(const RenderRequest& request);

/// Reads a camera: {"width", "height", "K": 3x3, "T_cam_world": 4x4, "pixel_centre": 0.5 (default)
/// or 0}. Without T_cam_world the camera stands in the world's origin. Throws InputError.
splat::View read_camera_json(const std::filesystem::path& path);

}  // namespace apvi::bridge
