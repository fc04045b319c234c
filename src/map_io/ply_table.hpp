// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
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

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::ascii;
  std::int64_t vertices = 0;
  std::vector<PlyProperty> properties;  ///< of the "vertex" element, the first of the file
  std::vector<std::string> comments;
  int lines = 0;  ///< number of lines of the header
};

/// Destination of one property: `to`[row * `stride`].
struct PlyColumn {
  std::size_t property = 0;
  float* to = nullptr;
  std::int64_t stride = 1;
};

/// The vertices of a PLY file as a table of numbers. The vertex count is checked against the file
/// size before anything is allocated.
class PlyTable {
 public:
  /// Reads the header. Throws InputError with file and line.
  explicit PlyTable(const std::filesystem::path& path);

  const PlyHeader& header() const { return header_; }
  /// Index of the property with that name.
  std::optional<std::size_t> find(std::string_view name) const;
  /// The same; throws InputError when it does not exist.
  std::size_t require_property(std::string_view name) const;
  /// Fills the columns with all vertices; call once. Throws InputError when the file ends early or
  /// contains text that is not a number.
  void read(const std::vector<PlyColumn>& columns);

 private:
  void check_size();
  void read_ascii(const std::vector<PlyColumn>& columns);
  void read_binary(const std::vector<PlyColumn>& columns);

  std::string name_;
  std::ifstream in_;
  PlyHeader header_;
  std::int64_t row_bytes_ = 0;  // of a binary file
};

}  // namespace apvi::map_io
