// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>

#include "gaussians/render/view.hpp"

namespace apvi::runs {

struct RenderRequest {
  std::filesystem::path source;  ///< run folder or .ply file
  std::filesystem::path
      path{};  ///< trajectory to render along: of the run's body, or of the camera
  std::filesystem::path camera{};  ///< camera.json: one view, or the lens for `path`
  std::filesystem::path out;       ///< folder
  bool restore = false;            ///< also render without water
  bool depth = false;              ///< also render depth
  bool as_float = false;           ///< PFM instead of PNG
};

/// Renders a map along a path or from one camera into `out`; with neither, along the keyframes of
/// the run folder. Files are named by stamp [ns], or after the map file for one camera: NAME.png
/// (with water), NAME_restored.png (without water), NAME_depth.png (16 bit, millimeters); with
/// `as_float` .pfm (depth in meters). Returns the number of views. Throws InputError for invalid
/// input.
std::size_t render_run(const RenderRequest& request);

/// Reads a camera: {"width", "height", "K": 3x3, "T_cam_world": 4x4, "pixel_center": 0.5 (default)
/// or 0}. Without T_cam_world the camera is at the world's origin. Throws InputError.
gaussians::View read_camera_json(const std::filesystem::path& path);

}  // namespace apvi::runs
