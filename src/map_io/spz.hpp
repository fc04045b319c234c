// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "map_io/splats.hpp"

namespace apvi::map_io {

/// SPZ files of Niantic: gzip of a header of 16 bytes and the attributes one after the other.
/// Positions are fixed-point numbers of 24 bits, opacities, colors, log scales and SH coefficients
/// bytes. The axes of the files are x right, y up, z back; those of `Splats` are the axes of PLY
/// files, x right, y down, z forward: y and z change their signs.

struct SpzSplats {
  Splats splats;
  bool antialiased = false;
};

/// Whether the bytes begin as a gzip file does.
bool is_gzip(const std::vector<unsigned char>& bytes);
/// Reads versions 2 and 3; SH coefficients above degree 3 are dropped. The number of Gaussians is
/// checked against the file size before memory is allocated. Throws InputError.
SpzSplats read_spz(const std::vector<unsigned char>& bytes, const std::string& name);
/// Writes version 3. Positions have 12 fractional bits (0.24 mm), or fewer if the map extends
/// beyond 2048 m. Values outside the range of the format are limited: log scales to [-10, 5.94], SH
/// coefficients to [-1, 1]. Throws InputError when a position is beyond 8388 km.
void write_spz(std::ostream& out, const SpzSplats& map);

}  // namespace apvi::map_io
