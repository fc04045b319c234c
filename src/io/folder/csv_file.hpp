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

/// A CSV file with a header line, read row by row; columns are found by name. Accepts CRLF, a byte
/// order mark, blank lines and comment lines (`#`). Memory does not grow with the file.
class CsvFile {
 public:
  /// Opens the file and reads its header. Throws InputError when it cannot be opened, is a folder,
  /// is empty, or starts with numbers instead of a header.
  explicit CsvFile(const std::filesystem::path& path);
  /// Reads from any stream; `name` is the file name for messages.
  CsvFile(std::unique_ptr<std::istream> in, std::string name);

  /// Index of the first of these names that is a column, ignoring "#", unit and case.
  std::optional<std::size_t> find(std::initializer_list<std::string_view> names) const;
  /// As `find`; throws InputError with the file and the first name when there is no such column.
  std::size_t require_column(std::initializer_list<std::string_view> names) const;
  /// Unit in brackets after the column's name: "ns" in "#timestamp [ns]"; "" if absent.
  const std::string& unit(std::size_t column) const { return units_[column]; }

  /// Advances to the next row; false at the end of the file.
  bool next();
  /// Text of a cell, trimmed; empty when the row is too short.
  std::string_view cell(std::size_t column) const;
  /// Whether the row has as many cells as the header (extra cells must be empty).
  bool complete() const;
  /// The first column as nanoseconds (by its unit), within [0, 4.5e18]; nullopt otherwise.
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

/// Upper limit of plausible stamps (year 2112); differences of stamps in [0, limit] cannot
/// overflow.
inline constexpr std::int64_t kMaxStampNs = 4'500'000'000'000'000'000;

/// Opens a file for reading. Throws InputError when this fails.
std::unique_ptr<std::istream> open_text(const std::filesystem::path& path);

}  // namespace apvi::io
