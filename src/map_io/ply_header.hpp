// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <iosfwd>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace apvi::map_io {

enum class PlyEncoding { ascii, little_endian, big_endian };
enum class PlyType { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::float32;
};

struct PlyElement {
  std::string name;
  std::int64_t rows = 0;
  std::vector<PlyProperty> properties;  ///< without the lists
  bool has_list = false;                ///< then rows have no fixed size

  /// Index of the property with that name.
  std::optional<std::size_t> find(std::string_view property) const;
  /// Bytes of a row in a binary file without lists.
  std::int64_t row_bytes() const;
};

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::ascii;
  std::vector<PlyElement> elements;  ///< in the order of the file; one is "vertex"
  std::vector<std::string> comments;
  int lines = 0;  ///< number of lines of the header

  /// The first element with that name; nullptr when there is none.
  const PlyElement* find(std::string_view element) const;
};

/// Reads a header up to and including end_header. `file` is for messages. Throws InputError with
/// file and line.
PlyHeader read_ply_header(std::istream& in, const std::string& file);
/// Bytes of one value in a binary file.
std::int64_t size_of(PlyType type);

}  // namespace apvi::map_io
