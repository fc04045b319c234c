// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "importer/colmap_model.hpp"
#include "importer/dive_writer.hpp"
#include "importer/import.hpp"

namespace apvi::importer {

/// What another program has reconstructed of images of one camera.
struct PosedImages {
  CameraModel::Parameters camera;
  std::vector<ColmapImage> images;  ///< in the order of their names
  std::vector<ColmapPoint> points;
  double scale = 1.0;   ///< meters, or what counts as one, per unit of poses and points
  std::string program;  ///< for messages: "COLMAP"
};

/// Copies the images from `files`, and writes poses, points and rig.yaml. Images without a file are
/// skipped with a warning. Throws InputError when the first image has another size than the camera.
ImportResult import_posed(const std::filesystem::path& files, const PosedImages& posed,
                          const ImportOptions& options, DiveWriter& dive);

}  // namespace apvi::importer
