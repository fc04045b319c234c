// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <istream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "map_io/ply_header.hpp"

namespace apvi::map_io {

/// Destination of one property: `to`[row * `stride`] = value - `offset`. The difference is taken in
/// double precision.
struct PlyColumn {
  std::size_t property = 0;
  float* to = nullptr;
  std::int64_t stride = 1;
  double offset = 0.0;
  double* exact = nullptr;  ///< used instead of `to`, for integers of 32 bits
};

/// One element of a PLY file as a table of numbers; by default the vertices. The number of rows is
/// checked against the file size before anything is allocated.
class PlyTable {
 public:
  /// Reads the header. Throws InputError with file and line, also when there is no such element or
  /// lists precede it in a binary file.
  explicit PlyTable(const std::filesystem::path& path, std::string_view element = "vertex");
  /// From a stream that can seek; `name` is for messages.
  PlyTable(std::unique_ptr<std::istream> in, std::string name, std::string_view element = "vertex");

  const PlyHeader& header() const { return header_; }
  const PlyElement& element() const { return element_; }
  std::int64_t rows() const { return element_.rows; }
  const std::string& name() const { return name_; }
  /// Index of the property with that name.
  std::optional<std::size_t> find(std::string_view property) const {
    return element_.find(property);
  }
  /// The same; throws InputError when it does not exist.
  std::size_t require_property(std::string_view property) const;
  /// Fills the columns with all rows; call once. Throws InputError when the file ends early or
  /// contains text that is not a number.
  void read(const std::vector<PlyColumn>& columns);

 private:
  void open(std::string_view element);
  void skip(const PlyElement& element);
  void check_size(const PlyElement& element);
  void read_ascii(const std::vector<PlyColumn>& columns);
  void read_binary(const std::vector<PlyColumn>& columns);

  std::string name_;
  std::unique_ptr<std::istream> in_;
  PlyHeader header_;
  PlyElement element_;
};

}  // namespace apvi::map_io
