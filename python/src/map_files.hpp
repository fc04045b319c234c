// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <vector>

#include "apvi/slam/map_snapshot.hpp"

namespace apvi::python {

/// The map of a run folder, with its keyframes, or of a map file. Throws InputError.
slam::MapSnapshot read_map(const std::filesystem::path& source);
/// Writes a map file; the ending of its name decides the format. Throws InputError for an unknown
/// ending, RunError when it cannot be written.
void save_map(const slam::MapSnapshot& map, const std::filesystem::path& path);
/// Mean colors of the Gaussians over all directions, in image values: RGB row by row.
std::vector<float> image_colors(const slam::MapSnapshot& map);

}  // namespace apvi::python
