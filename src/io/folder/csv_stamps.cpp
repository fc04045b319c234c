// SPDX-License-Identifier: BSD-3-Clause
#include <iterator>
#include <string>
#include <vector>

#include "apvi/core/error.hpp"
#include "core/date_time.hpp"
#include "core/median.hpp"
#include "core/text.hpp"
#include "io/folder/csv_cells.hpp"
#include "io/folder/csv_file.hpp"
#include "io/folder/time_column.hpp"

// The unit of the stamps of a CSV file, and whether they are complete.
namespace apvi::io {
namespace {

// Rows that tell the unit of the stamps, and whether they lost digits.
constexpr std::size_t kStampRows = 1000;
constexpr std::size_t kFewRows = 20;      // less say nothing about lost digits
constexpr double kMinStepNs = 100'000.0;  // IMUs are read at 8 kHz at most

// Bytes at the end of a file that hold a few rows of any sensor, and stamps of which the median is
// the beginning or the end of a recording, whatever a single one is.
constexpr std::uint64_t kTailBytes = 8192;
constexpr std::ptrdiff_t kSpanRows = 9;
constexpr std::size_t kLastRows = 50;

double median_of(std::vector<double>::const_iterator begin,
                 std::vector<double>::const_iterator end) {
  return median(std::vector<double>(begin, end));
}

// "2024-05-01T12:00:00Z", "01.05.2024 12:00:00", "12:00:00.5"
bool is_date(std::string_view stamp) {
  return stamp.find_first_of("0123456789") == 0 &&
         (stamp.find(':') != std::string_view::npos || stamp.find('-') != stamp.rfind('-'));
}

bool is_time_of_day(std::string_view stamp) {
  return is_date(stamp) && stamp.find_first_not_of("0123456789:.,") == std::string_view::npos;
}

// Why a date cannot be read, and what to do.
std::string_view refusal_of(std::string_view stamp) {
  if (is_time_of_day(stamp)) {
    return "a time of day without a date; add a column date (2024-05-01)";
  }
  const bool year_first = stamp.find_first_not_of("0123456789") == 4;
  const bool has_words = stamp.find_first_not_of("0123456789./-: ,T+Z") != std::string_view::npos;
  if (!year_first && !has_words && stamp.find_first_of("./-") != std::string_view::npos) {
    return "a date whose day and month may be confused; write it as 2024-05-01T12:00:00Z, or the "
           "time as a number, in s or ns since 1970";
  }
  return "no date and time as 2024-05-01T12:00:00Z; write it so, or as a number, in s or ns since "
         "1970";
}

}  // namespace

// As written; a date in a column of its own precedes the time of day.
std::string CsvFile::time_cell() const {
  const std::string time(cell(time_column_));
  return date_column_ ? fmt::format("{}T{}", cell(*date_column_), time) : time;
}

// A number; a date is converted to nanoseconds.
std::string CsvFile::time_text() const {
  if (!has_dates_) return separator_ == ',' ? time_cell() : with_decimal_point(time_cell());
  const auto stamp = parse_date_time(time_cell());
  return stamp ? std::to_string(stamp->ns) : "";
}

std::vector<std::string> CsvFile::first_times() {
  std::vector<std::string> times;
  look_ahead([&] {
    times.push_back(time_text());
    return times.size() < kStampRows;
  });
  return times;
}

// Looks for dates instead of numbers.
void CsvFile::read_dates() {
  const auto date = find({"date", "utc_date"});
  std::size_t rows = 0;
  std::size_t dates = 0;
  std::string first;
  look_ahead([&] {
    if (rows == 0 && date && *date != time_column_ && is_time_of_day(cell(time_column_))) {
      date_column_ = date;
    }
    const std::string time = time_cell();
    if (first.empty()) first = time;
    dates += parse_date_time(time) ? 1 : 0;
    return ++rows < kStampRows;
  });
  has_dates_ = 2 * dates > rows;
  if (has_dates_ || !is_date(first)) return;
  fail_input("{}: column {}: \"{}\" is {}", name_, columns_[date_column_.value_or(time_column_)],
             first, refusal_of(first));
}

void CsvFile::read_time_unit() {
  read_dates();
  time_unit_is_stated_ = has_dates_;
  if (has_dates_) return;
  const std::string& column = columns_[time_column_];
  const std::string& stated = units_[time_column_];
  const Unit* unit =
      find_unit(Dimension::time, stated.empty() ? time_unit_in_name(column) : stated);
  if (!stated.empty() && unit == nullptr) {
    fail_input("{}:{}: column {}: unknown time unit [{}]; known: {}", name_, line_number_, column,
               stated, known_units(Dimension::time));
  }
  const std::vector<std::string> times = first_times();
  time_unit_is_stated_ = unit != nullptr;
  time_power_ = unit != nullptr ? unit->time_power : guess_time_power(times, 0);
  if (time_power_ == 0) check_nanoseconds(times, unit != nullptr);
}

// The stamps at the end of the file. Empty when it cannot be read twice.
std::vector<double> CsvFile::last_times() {
  std::vector<double> times;
  bool at_end = size_ < bytes_read_ + kTailBytes;
  look_ahead([&] {
    if (!order_.empty() && !at_end) {
      next_row_ = order_.size() - std::min(order_.size(), kLastRows);
      at_end = true;
      return true;
    }
    if (!at_end) {
      in_->seekg(static_cast<std::streamoff>(size_ - kTailBytes));
      at_end = true;
      read_line();  // begins within a row
      return true;
    }
    if (const auto time = text::parse_double(time_text())) times.push_back(*time);
    return true;
  });
  return times;
}

std::optional<StampSummary> CsvFile::stamp_summary() {
  const std::vector<std::string> rows = first_times();
  const std::vector<double> end = last_times();
  std::vector<double> begin;
  for (const std::string& row : rows) {
    if (const auto time = text::parse_double(row)) begin.push_back(*time);
  }
  if (std::ssize(begin) < kSpanRows || std::ssize(end) < kSpanRows) return std::nullopt;
  const double step = median_time_step(rows);
  const double half = 0.5 * static_cast<double>(kSpanRows - 1) * step;  // from median to end
  return StampSummary{.column = fmt::format("{}: column {}", name_, columns_[time_column_]),
                      .is_stated = time_unit_is_stated_,
                      .power = time_power_,
                      .order = order_remark_,
                      .first = median_of(begin.begin(), begin.begin() + kSpanRows) - half,
                      .last = median_of(end.end() - kSpanRows, end.end()) + half,
                      .step = step};
}

// Numbers that are something else than the nanoseconds that they are taken for.
void CsvFile::check_nanoseconds(const std::vector<std::string>& times, bool stated) const {
  if (times.empty()) return;
  const std::string& column = columns_[time_column_];
  if (stated && guess_time_power(times, 0) == 9) {
    fail_input("{}: column {}: nanoseconds have no decimals, but {} has: is it [s]?", name_, column,
               times.front());
  }
  const double step = median_time_step(times);
  if (stated || times.size() < kFewRows || step <= 0.0 || step >= kMinStepNs) return;
  fail_input(
      "{}: column {} has no unit and steps by {:.6g}, too little for nanoseconds; name the unit "
      "in the header, such as {} [ms]",
      name_, column, step, column);
}

// Stamps written with too few digits are equal from row to row, although the values change. Rows
// that repeat everything are a log of the last value.
void CsvFile::check_stamps() {
  std::size_t rows = 0;
  std::size_t merged = 0;
  std::string before;
  std::string values_before;
  look_ahead([&] {
    const std::string stamp(cell(time_column_));
    std::string values;
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      if (i != time_column_) values.append(cells_[i]).push_back(separator_);
    }
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
  const std::string_view text = cell(time_column_);
  const bool comma = separator_ != ',' && text.find(',') != std::string_view::npos;
  const bool as_written = !comma && !has_dates_;
  const auto ns = as_written ? text::parse_scaled_int64(text, time_power_)
                             : text::parse_scaled_int64(time_text(), time_power_);
  if (!ns || *ns < 0 || *ns > kMaxStampNs) return std::nullopt;
  return ns;
}

}  // namespace apvi::io
