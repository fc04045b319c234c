// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <span>

namespace apvi::io {

/// Whether the end of a JPEG or PNG file is present. Image libraries fill the missing rows of an
/// incomplete file with gray and report success. True for all other formats.
bool is_complete_image_file(std::span<const std::uint8_t> bytes);

}  // namespace apvi::io
