// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <istream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace apvi::io {

/// A csv file with a header line, read row by row; columns are found by name. Knows comma, CRLF, a
/// byte order mark, blank lines and comment lines (`#`). Memory does not grow with the file.
class CsvFile {
 public:
  /// Opens the file and reads its header. Throws InputError when it cannot be opened, is a folder,
  /// is empty, or begins with numbers instead of a header.
  explicit CsvFile(const std::filesystem::path& path);
  /// The same from any stream; `name` stands for the file in messages.
  CsvFile(std::unique_ptr<std::istream> in, std::string name);

  /// Index of the first column that has one of these names, without "#", unit and case.
  std::optional<std::size_t> find(std::initializer_list<std::string_view> names) const;
  /// The same; throws InputError naming the file and the first of the names when there is none.
  std::size_t need(std::initializer_list<std::string_view> names) const;
  /// What stands in brackets behind the column's name: "ns" in "#timestamp [ns]"; "" without.
  const std::string& unit(std::size_t column) const { return units_[column]; }

  /// Goes to the next row; false at the end of the file.
  bool next();
  /// Text of a cell, trimmed; empty when the row is too short.
  std::string_view cell(std::size_t column) const;
  /// Whether the row has as many cells as the header (or only empty ones more).
  bool complete() const;
  /// The first column as nanoseconds (by its unit), within [0, 4.5e18]; nothing for anything else.
  std::optional<std::int64_t> stamp_ns() const;

  const std::string& name() const { return name_; }
  /// "file:line" of the current row.
  std::string where() const;
  double fraction() const;

 private:
  bool read_line();
  void read_header();

  std::unique_ptr<std::istream> in_;
  std::string name_;
  std::uint64_t size_ = 0;
  std::uint64_t bytes_read_ = 0;
  std::size_t line_number_ = 0;
  bool too_long_ = false;
  std::vector<char> buffer_;
  std::string_view line_;
  std::vector<std::string> columns_;
  std::vector<std::string> units_;
  std::vector<std::string_view> cells_;
};

/// Stamps outside [0, this] are no time of any recording (the year 2112), and differences of stamps
/// inside never overflow.
inline constexpr std::int64_t kMaxStampNs = 4'500'000'000'000'000'000;

/// Opens a file for reading, or throws InputError that says what is wrong with the path.
std::unique_ptr<std::istream> open_text(const std::filesystem::path& path);

}  // namespace apvi::io
