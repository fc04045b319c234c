// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "apvi/geometry/se3.hpp"
#include "apvi/sensors/camera_model.hpp"

/// Cameras exported by Agisoft Metashape ("Export Cameras", Agisoft XML).
namespace apvi::importer {

struct MetashapeImage {
  std::string label;  ///< usually the name of the file, often without its ending
  SE3 T_model_camera;
};

/// The images of the sensor with most of them.
struct MetashapeModel {
  CameraModel::Parameters camera;
  std::vector<MetashapeImage> images;
  std::size_t of_other_sensors = 0;
  std::optional<double> scale;  ///< meters per unit of the poses, if the chunk has a reference
};

/// Whether the beginning of a file is that of such an export.
bool is_metashape(std::string_view begin);

/// Parses a file. The camera is in this project's convention: the center of the first pixel is
/// (0, 0), and p1, p2 are those of OpenCV, which Metashape has in the other order. Throws
/// InputError, beginning with `name`, for damaged files and for lenses that cannot be expressed.
MetashapeModel parse_metashape(const std::string& xml, const std::string& name);

}  // namespace apvi::importer
