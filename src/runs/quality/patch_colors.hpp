// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "eval/metrics_file.hpp"

namespace apvi::runs {

/// A patch of known color in an image, for example a field of a color chart.
struct Patch {
  std::int64_t stamp_ns = 0;          ///< of the image
  std::array<int, 4> rectangle{};     ///< x, y, width, height in the recorded image [px]
  std::array<double, 3> reference{};  ///< linear light, RGB
};

/// Reads `#timestamp [ns],x,y,width,height,red,green,blue`, colors as sRGB values from 0 to 255.
/// Throws InputError with file and line for a row that cannot be used, and without rows.
std::vector<Patch> read_patches(const std::filesystem::path& file);

/// Color of a patch in the image and in the restored rendering from the image's pose, as linear
/// light. The rendering has the map's exposure for viewing.
struct PatchColor {
  std::array<double, 3> reference{};
  std::array<double, 3> image{};
  std::array<double, 3> restored{};
};

/// Angle between two colors as vectors in linear RGB [degrees], which does not depend on
/// brightness (Akkaynak and Treibitz, "Sea-thru", CVPR 2019, measure gray patches so).
double color_angle_deg(const std::array<double, 3>& a, const std::array<double, 3>& b);

struct PatchErrors {
  std::size_t patches = 0;
  double image_deg = 0.0;     ///< mean angle
  double restored_deg = 0.0;  ///< mean angle, in the white balance for viewing
  /// Mean angles after one white balance for all patches, which leaves only what changes with range
  /// and light; none for fewer than two patches.
  std::optional<double> image_balanced_deg, restored_balanced_deg;
};
PatchErrors errors_of(const std::vector<PatchColor>& patches);
eval::Json to_json(const PatchErrors& errors);

/// Measures patches of a run with a map. Patches whose image or pose is missing are left out with a
/// warning. Throws InputError when none is left.
std::vector<PatchColor> measure_patches(const std::filesystem::path& run,
                                        const std::vector<Patch>& patches);

}  // namespace apvi::runs
