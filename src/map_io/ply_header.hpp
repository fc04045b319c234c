// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <iosfwd>
#include <string>

#include "map_io/ply_table.hpp"

namespace apvi::map_io {

/// Reads a header up to and including end_header. `file` is for messages. Throws InputError with
/// file and line.
PlyHeader read_ply_header(std::istream& in, const std::string& file);
/// Bytes of one value in a binary file.
std::int64_t size_of(PlyType type);

}  // namespace apvi::map_io
