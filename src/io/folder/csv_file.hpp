// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <istream>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/folder/units.hpp"
#include "io/sample_source.hpp"

namespace apvi::io {

/// Why a row cannot be used: the kind of problem, and the text at fault ("" when a cell is
/// missing).
struct RowProblem {
  std::string kind;
  std::string text;
};

/// A column with numbers, and the factor from the header's unit to SI.
struct Quantity {
  std::size_t column = 0;
  double to_si = 1.0;
  bool has_unit = false;
};

/// A CSV file with a header line, read row by row; columns are found by name. A second line may
/// have their units. Accepts CRLF, a byte order mark, blank lines, comment lines (`#`), quoted
/// cells, and semicolons or tabs instead of commas (then also decimal commas). Rows that were mixed
/// up come in order of time, see `order_by_time`. Memory does not grow with a file that is in
/// order.
class CsvFile {
 public:
  using Names = std::initializer_list<std::string_view>;

  /// Opens the file and reads its header. Throws InputError when it cannot be opened, is a folder,
  /// is empty, is UTF-16, or starts with numbers instead of a header. Comments may precede it.
  explicit CsvFile(const std::filesystem::path& path);
  /// Reads from any stream; `name` is the file name for messages.
  CsvFile(std::unique_ptr<std::istream> in, std::string name);

  /// Index of the first of these names that is a column, ignoring "#", unit and case.
  std::optional<std::size_t> find(Names names) const;
  /// As `find`; throws InputError with the file and the first name when there is no such column.
  std::size_t require_column(Names names) const;
  /// A column of numbers: named as given, or with a unit's name appended ("depth_cm"). Throws
  /// InputError with the known units when the header names another one.
  std::optional<Quantity> find_quantity(Names names, Dimension dimension) const;
  /// As `find_quantity`; throws InputError when there is no such column.
  Quantity require_quantity(Names names, Dimension dimension) const;
  /// Unit in brackets or parentheses after the column's name: "ns" in "#timestamp [ns]"; "" if
  /// absent.
  const std::string& unit(std::size_t column) const { return units_[column]; }
  const std::string& column_name(std::size_t column) const { return columns_[column]; }

  /// Advances to the next row; false at the end of the file.
  bool next();
  /// Text of a cell, trimmed and without quotes; empty when the row is too short.
  std::string_view cell(std::size_t column) const;
  /// The number in a cell as written; nullopt for anything else.
  std::optional<double> number(std::size_t column) const;
  /// The number in a cell in SI units.
  std::optional<double> number(const Quantity& quantity) const;
  /// Whether the row has as many cells as the header (extra cells must be empty).
  bool complete() const;
  /// The time of the row as nanoseconds (by its unit, or of a date), within [0, 4.5e18]; nullopt
  /// otherwise. Without a unit the first rows tell it.
  std::optional<std::int64_t> stamp_ns() const;
  /// What the rows that follow tell of the unit of the stamps; nullopt for fewer than ten of them,
  /// and when the input cannot be read twice (a pipe).
  std::optional<StampSummary> stamp_summary();
  /// Replaces the unit of the stamps by this power of ten of nanoseconds.
  void set_stamp_power(int power) { time_power_ = has_dates_ ? 0 : power; }
  /// What is wrong with the row's cells or stamp; nullopt when nothing is.
  std::optional<RowProblem> problem() const;

  /// Notes that a cell cannot be used: "column NAME" and `why` become its problem.
  void refuse(std::size_t column, std::string_view why) const;
  /// The last cell that was refused or that `number` could not read; nullopt when there was none in
  /// this row.
  std::optional<RowProblem> cell_problem() const;

  /// Calls `visit` for each of the remaining rows, until it returns false, and then goes back, so
  /// that `next` gives the same rows again. False when the input cannot be read twice (a pipe);
  /// nothing is read then.
  bool look_ahead(const std::function<bool()>& visit);

  const std::string& name() const { return name_; }
  /// "file:line" of the current row.
  std::string where() const;
  double fraction() const;

 private:
  bool read_line();
  void check_encoding() const;
  std::string_view find_header();
  void read_header();
  void read_unit_row();
  [[noreturn]] void fail_for_one_column() const;
  void read_time_unit();
  void read_dates();
  void check_stamps();
  void find_order();
  bool is_in_order();
  bool is_header_again() const;
  bool seek_next_row();
  bool is_at_end() const;
  std::string time_cell() const;
  std::string time_text() const;
  std::optional<double> time_number() const;
  std::vector<std::string> first_times();
  std::vector<double> last_times();
  void check_nanoseconds(const std::vector<std::string>& times, bool stated) const;
  void split_cells(std::string_view line);
  const Unit* unit_in_name(std::size_t column, Names names, Dimension dimension) const;

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
  struct Refused {
    std::size_t column = 0;
    std::string_view why;  // a literal
  };
  mutable std::optional<Refused> refused_;  // the last cell that could not be used
  char separator_ = ',';
  std::size_t time_column_ = 0;
  int time_power_ = 0;  // of ten nanoseconds: unit of the time
  bool time_unit_is_stated_ = false;
  bool has_dates_ = false;                  // instead of numbers
  std::optional<std::size_t> date_column_;  // of a time of day

  struct RowPlace {
    std::uint64_t begin = 0;  // first byte
    std::size_t line_number = 0;
  };
  std::uint64_t row_begin_ = 0;
  std::vector<RowPlace> order_;  // rows by time; empty when the file is in order
  std::size_t next_row_ = 0;     // in `order_`
  std::string order_remark_;
};

/// Upper limit of plausible stamps (year 2112); differences of stamps in [0, limit] cannot
/// overflow.
inline constexpr std::int64_t kMaxStampNs = 4'500'000'000'000'000'000;

/// Opens a file for reading. Throws InputError when this fails.
std::unique_ptr<std::istream> open_text(const std::filesystem::path& path);

}  // namespace apvi::io
