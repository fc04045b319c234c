// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>

#include "gaussians/render/view.hpp"
#include "map_io/origin.hpp"

namespace apvi::runs {

enum class ImageFormat {
  png,  ///< depth in millimeters, 16 bit
  pfm,  ///< float; depth in meters, restored images in linear light
  exr,  ///< float; depth in meters, all colors in linear light
};

struct RenderRequest {
  std::filesystem::path source;  ///< run folder or map file
  std::filesystem::path
      path{};  ///< trajectory to render along: of the run's body, or of the camera
  std::filesystem::path camera{};  ///< camera.json: one view, or the lens for `path`
  std::filesystem::path out;       ///< folder
  bool restore = false;            ///< also render without water
  bool depth = false;              ///< also render depth
  double detail_px = 0.0;          ///< see gaussians::DetailLevels; 0: all Gaussians
  ImageFormat format = ImageFormat::png;
  int bits = 8;  ///< of a color PNG: 8 or 16
  /// Brightness of restored images: a factor; empty: chosen for the map, see
  /// mapping::DisplayExposure.
  std::optional<double> exposure{};
  bool white_balance = true;  ///< of restored images, chosen for the map
};

/// Renders a map along a path or from one camera into `out`; with neither, along the keyframes of
/// the run folder. Files are named by stamp [ns], or after the map file for one camera: NAME.png
/// (with water), NAME_restored.png (without water), NAME_depth.png, or with the extension of
/// another format, whose colors are not compressed or clamped. Poses are in the recording's
/// coordinates. Returns the number of views. Throws InputError for invalid input.
std::size_t render_run(const RenderRequest& request);

/// Reads a camera: {"width", "height", "K": 3x3, "T_cam_world": 4x4, "pixel_center": 0.5 (default)
/// or 0}. T_cam_world is for the recording's world, the result for that of a map with this local
/// origin; without T_cam_world the camera is at the map's origin. Throws InputError.
gaussians::View read_camera_json(const std::filesystem::path& path,
                                 const map_io::Origin& origin = {});

}  // namespace apvi::runs
