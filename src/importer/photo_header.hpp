// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>

#include "importer/assumed_camera.hpp"
#include "importer/byte_reader.hpp"

namespace apvi::importer {

/// What the header of a photograph tells.
struct PhotoHeader {
  ImageSize size;
  std::optional<std::int64_t> taken_ns;     ///< EXIF: camera's local time, as if it were UTC
  std::optional<double> focal_length_35mm;  ///< EXIF: for an image 36 mm wide [mm]
};

/// Parses a JPEG or PNG header; nullopt for anything else, or without a size.
std::optional<PhotoHeader> parse_photo_header(Bytes file);
/// Reads what `parse_photo_header` needs of a file. Throws InputError when it cannot be read.
std::optional<PhotoHeader> read_photo_header(const std::filesystem::path& path);

}  // namespace apvi::importer
