// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace apvi::splat {

enum class PlyEncoding { ascii, little_endian, big_endian };
enum class PlyType { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::float32;
};

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::ascii;
  std::int64_t vertices = 0;
  std::vector<PlyProperty> properties;  ///< of the element "vertex", the file's first
  std::vector<std::string> comments;
  int lines = 0;  ///< of the header
};

/// Where the numbers of one property go: `to`[row * `stride`].
struct PlyColumn {
  std::size_t property = 0;
  float* to = nullptr;
  std::int64_t stride = 1;
};

/// The vertices of a PLY file as a table of numbers. What the header claims is held against the
/// size of the file before anything is allocated.
class PlyTable {
 public:
  /// Reads the header. Throws InputError with file and line.
  explicit PlyTable(const std::filesystem::path& path);

  const PlyHeader& header() const { return header_; }
  /// Index of the property of that name.
  std::optional<std::size_t> find(std::string_view name) const;
  /// The same; throws InputError when there is none.
  std::size_t need(std::string_view name) const;
  /// Fills the columns with all vertices; once. Throws InputError when the file ends too early or
  /// holds what is no number.
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

}  // namespace apvi::splat
