// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <iosfwd>
#include <string>
#include <string_view>

#include "map_io/ply_table.hpp"
#include "map_io/splats.hpp"

namespace apvi::map_io {

/// The compressed PLY files of SuperSplat: 16 bytes for each Gaussian, in chunks of 256 that share
/// the bounds of their positions, log scales and colors. Position and log scale have 11, 10 and 11
/// bits, rotation 2 + 3 x 10, color and opacity 8 bits; SH coefficients one byte for [-4, 4].

/// Opens a table of an element of the same file.
using PlyOpener = std::function<PlyTable(std::string_view element)>;

/// Whether a header is that of a compressed file.
bool is_compressed_ply(const PlyHeader& header);
/// Reads a compressed file. Values may be NaN if the bounds are. Throws InputError.
Splats read_compressed_ply(const PlyOpener& open);
/// Writes a compressed file; `comments` are lines of the header. The Gaussians are sorted along a
/// Morton curve, so that a chunk is small. Log scales are limited to [-20, 20].
void write_compressed_ply(std::ostream& out, const Splats& splats, const std::string& comments);

}  // namespace apvi::map_io
