// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <string>

#include "apvi/core/error.hpp"
#include "core/text.hpp"
#include "io/folder/csv_cells.hpp"
#include "io/folder/csv_file.hpp"

// The unit of the stamps of a CSV file, and whether they are complete.
namespace apvi::io {
namespace {

// Rows that tell the unit of the stamps, and whether they lost digits.
constexpr std::size_t kStampRows = 1000;
constexpr std::size_t kFewRows = 20;  // less say nothing about lost digits

}  // namespace

void CsvFile::read_time_unit() {
  const std::string& column = columns_.front();
  const std::string suffix = column.substr(std::min(column.rfind('_'), column.size() - 1) + 1);
  const bool bracketed = !units_.front().empty();
  const Unit* unit = find_unit(Dimension::time, bracketed ? units_.front() : suffix);
  if (bracketed && unit == nullptr) {
    fail_input("{}:{}: column {}: unknown time unit [{}]; known: {}", name_, line_number_, column,
               units_.front(), known_units(Dimension::time));
  }
  if (unit != nullptr) {
    time_power_ = unit->time_power;
    return;
  }
  std::vector<std::string> stamps;
  look_ahead([&] {
    stamps.push_back(with_decimal_point(cell(0)));
    return stamps.size() < kStampRows;
  });
  time_power_ = guess_time_power(stamps, 0);
}

// Stamps written with too few digits are equal from row to row, although the values change. Rows
// that repeat everything are a log of the last value.
void CsvFile::check_stamps() {
  std::size_t rows = 0;
  std::size_t merged = 0;
  std::string before;
  std::string values_before;
  look_ahead([&] {
    const std::string stamp(cell(0));
    const std::string values(line_.substr(std::min(line_.find(separator_), line_.size())));
    merged += stamp_ns() && stamp == before && values != values_before ? 1 : 0;
    before = stamp;
    values_before = values;
    return ++rows < kStampRows;
  });
  if (rows < kFewRows || 2 * merged < rows) return;
  fail_input(
      "{}: {} of the first {} rows have the stamp of the row before, such as {}: the stamps lost "
      "digits; export them in full",
      name_, merged, rows, before);
}

std::optional<std::int64_t> CsvFile::stamp_ns() const {
  const bool comma = separator_ != ',' && cell(0).find(',') != std::string_view::npos;
  const auto ns =
      text::parse_scaled_int64(comma ? with_decimal_point(cell(0)) : cell(0), time_power_);
  if (!ns || *ns < 0 || *ns > kMaxStampNs) return std::nullopt;
  return ns;
}

}  // namespace apvi::io
