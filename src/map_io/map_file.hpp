// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>

#include "gaussians/model/gaussians.hpp"
#include "gaussians/render/tone_curve.hpp"
#include "map_io/origin.hpp"
#include "medium/medium.hpp"
#include "medium/vignetting.hpp"

namespace apvi::map_io {

/// A map as a file of any format: PLY, compressed PLY (NAME.compressed.ply) or SPZ.
struct MapFile {
  /// float32 on the CPU; positions relative to `origin`, colors in linear light. Files have colors
  /// in image values, as other programs show them.
  gaussians::Gaussians gaussians;
  std::optional<medium::Medium> medium = std::nullopt;
  Origin origin{};
  bool antialiased = false;              ///< as it was trained; only SPZ stores it
  gaussians::ToneCurve tone_curve = {};  ///< of the camera; SPZ does not store it
  medium::Vignetting vignetting = {};    ///< of the camera; SPZ does not store it
};

/// Whether the file name ends as that of a map file does.
bool is_map_name(const std::filesystem::path& path);
/// Reads a map; the content decides the format. Throws InputError.
MapFile read_map(const std::filesystem::path& path);
/// Writes a map; the ending of the file name decides the format. PLY stores the medium and the
/// origin. SPZ stores neither: FILE.origin.json next to it has an origin that is not zero. Throws
/// InputError for an unknown ending, RunError when something cannot be written.
void write_map(const std::filesystem::path& path, const MapFile& map);

/// Writes {"origin_m": [x, y, z]}, or removes the file when the origin is zero.
void write_origin_json(const std::filesystem::path& path, const Origin& origin);

}  // namespace apvi::map_io
