// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <iosfwd>
#include <string>

#include "ply_table.hpp"

namespace apvi::splat {

/// Reads a header up to and with its end_header. `file` is for messages. Throws InputError with
/// file and line.
PlyHeader read_ply_header(std::istream& in, const std::string& file);
/// Bytes of one number in a binary file.
std::int64_t size_of(PlyType type);

}  // namespace apvi::splat
